"""Malformed inputs of every kind are answered in a sentence or read rightly; `python -m tests.malformed` tries more."""

import pytest

from tests.malformed.__main__ import run
from tests.malformed.registry import FAMILIES

CASES = {"recordings": 72, "commands": 78, "files": 36, "library": 45, "scenes": 60}
"""Of each family, so few that they take seconds."""


@pytest.mark.usefixtures("unchecked_types")
@pytest.mark.parametrize("family", FAMILIES)
def test_malformed_inputs_are_refused_in_a_sentence_or_read_rightly(family):
    """Oracle: the generator, which knows what it broke."""
    endings = run(CASES[family], 1, family)
    assert len(endings) == CASES[family]
    assert [str(each) for each in endings if each.ending != "sentence"] == []
