"""What is said of the end of an episode. Oracle: the enumeration, whose members have words and colours of their own."""

import re

from iwalker_jax.navigation import Outcome


def test_every_outcome_has_words_and_a_colour_of_its_own():
    for kind in ("word", "sentence", "colour"):
        assert len({getattr(outcome, kind) for outcome in Outcome}) == len(Outcome)
    assert all(re.fullmatch(r"#[0-9a-f]{6}", outcome.colour) for outcome in Outcome)


def test_words_are_the_names_in_plain_spelling_while_an_episode_ends():
    for outcome in set(Outcome) - {Outcome.RUNNING}:
        assert outcome.word == outcome.name.lower().replace("_", " ")
