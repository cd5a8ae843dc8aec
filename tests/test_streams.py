"""No two draws of a kind start from the same numbers: words of entropy and blocks of seeds, laid out and compared.

Oracles: NumPy's own seeding of the numbers written out here, as the shipped planner's data were made with, and sets.
"""

from itertools import combinations

import numpy as np
import pytest

from iwalker_jax import streams
from iwalker_jax.errors import InputError
from iwalker_jax.scenes.built.demonstration_scenes import DEMONSTRATION_NAMES
from iwalker_jax.scenes.built.held_out_sequences import SEQUENCE_NAMES
from iwalker_jax.scenes.built.training_scenes import FAMILIES

BLOCKS = (
    streams.TRAINING_LAYOUTS,
    streams.UNSEEN_LAYOUTS,
    streams.SEQUENCE_PATHS,
    streams.UNSEEN_PATHS,
    streams.STUDY_TASKS,
    streams.COLLECTION_TASKS,
)
TOGETHER = ((streams.SEQUENCE_PATHS, streams.UNSEEN_PATHS),)
"""Blocks whose numbers seed one kind of draw; all others feed streams, or families, of their own."""


def start(generator: np.random.Generator) -> tuple:
    """What a generator starts from, as NumPy mixed it."""
    return tuple(generator.bit_generator.seed_seq.generate_state(8).tolist())


def test_each_stream_has_a_word_of_its_own():
    keys = [stream.key for stream in streams.STREAMS]
    assert len(set(keys)) == len(keys) and min(keys) >= streams.FAMILY_LIMIT > len(FAMILIES)


def test_generators_of_all_scenes_and_tasks_differ():
    """NumPy fills short entropy with zeros, so that [key, seed] is [key, seed, 0]: equal lengths keep it harmless."""
    made = [
        start(stream.generator(seed, attempt))
        for stream in (
            *(streams.family_stream(i) for i in range(len(FAMILIES))),
            streams.HELD_OUT_SCENES,
            streams.HELD_OUT_TASKS,
            streams.TRAINING_TASKS,
        )
        for seed in (0, 1, 2, 59, 7_919, 16_180, 2**31, streams.WORD - 1)
        for attempt in range(60)
    ]
    made += [start(streams.SEQUENCE_FURNITURE.generator(k)) for k in range(len(SEQUENCE_NAMES))]
    made += [start(streams.DEMONSTRATION_FURNITURE.generator(k)) for k in range(len(DEMONSTRATION_NAMES))]
    made += [
        start(streams.NAMED_TASKS.generator(*name.encode(), seed, attempt))
        for name in {*SEQUENCE_NAMES, *DEMONSTRATION_NAMES}  # those of one name draw alike
        for seed in (0, 1, 10_000, streams.WORD - 1)
        for attempt in range(20)
    ]
    assert len(set(made)) == len(made)


def test_a_seed_longer_than_a_word_would_meet_another_and_is_refused():
    long = np.random.default_rng([3, 2**32 + 5])
    assert start(long) == start(streams.family_stream(3).generator(5, 1))
    for seed in (2**32 + 5, -1):
        with pytest.raises(InputError, match=rf"{seed} is no seed; give a whole number from 0 to 4294967295"):
            streams.family_stream(3).generator(seed, 0)
    with pytest.raises(InputError, match="no number of a training family"):
        streams.family_stream(streams.FAMILY_LIMIT)


@pytest.mark.parametrize("blocks", BLOCKS, ids=lambda blocks: blocks.what)
def test_every_seed_has_numbers_of_its_own(blocks):
    """By hand: the last number of a seed's block is just before the first of the next."""
    last = blocks.seeds - 1
    for seed in (0, 1, last - 1):
        assert blocks.number(seed, blocks.size - 1) + 1 == blocks.number(seed + 1)
    assert blocks.number(0) == blocks.first and blocks.number(last, blocks.size - 1) < blocks.end <= streams.WORD
    for seed, index, sentence in (
        (last + 1, 0, "seed of .* must lie from 0"),
        (-1, 0, "seed of .* must lie from 0"),
        (0, blocks.size, "ask for fewer"),
        (0, -1, "ask for fewer"),
    ):
        with pytest.raises(InputError, match=sentence):
            blocks.number(seed, index)


@pytest.mark.parametrize("group", TOGETHER)
def test_blocks_of_one_kind_do_not_meet(group):
    for first, second in combinations(sorted(group, key=lambda blocks: blocks.first), 2):
        assert first.end <= second.first


def test_the_numbers_are_those_that_published_results_were_made_with():
    """Oracle: the arithmetic and NumPy's generators, written out."""
    assert streams.TRAINING_LAYOUTS.number(3, 7) == 300_007
    assert streams.UNSEEN_LAYOUTS.number(3, 7) == streams.STUDY_TASKS.number(3, 7) == 30_007
    assert streams.SEQUENCE_PATHS.number(4) == 1_000_007
    assert streams.UNSEEN_PATHS.number(3, 7) == 2_030_010
    assert streams.COLLECTION_TASKS.number(2, 5) == 3_000_005
    words = {
        streams.HELD_OUT_SCENES: 7_919,
        streams.HELD_OUT_TASKS: 16_180,
        streams.SEQUENCE_FURNITURE: 20_240,
        streams.NAMED_TASKS: 27_182,
        streams.DEMONSTRATION_FURNITURE: 31_415,
        streams.TRAINING_TASKS: 33_988,
    }
    assert set(words) == set(streams.STREAMS)
    for stream, word in words.items():
        wanted = np.random.default_rng([word, 5, 2]).uniform(size=4)
        np.testing.assert_array_equal(stream.generator(5, 2).uniform(size=4), wanted)
    wanted = int(np.random.SeedSequence([5, 1, 2]).generate_state(1)[0]) // 2
    assert streams.mixed_seed(5, 1, 2) == wanted


def test_mixed_seeds_differ():
    """Of the combinations that a few runs use, none share a seed; any two do with a probability of 2^-31."""
    seeds = {streams.mixed_seed(a, b, c) for a in range(12) for b in range(12) for c in range(12)}
    assert len(seeds) == 12**3 and all(0 <= seed < 2**31 for seed in seeds)
