"""Random streams in one table: which numbers each kind of draw starts from, so that no two draws of a kind can meet.

Scenes and tasks come from NumPy generators whose entropy begins with a word of their own (`Stream`):

    0, 1, ...  layouts of the training families, one word a family
    7919       held-out scenes
    16180      tasks in held-out scenes
    20240      furniture of the held-out sequences, designed by hand
    27182      tasks with names
    31415      furniture of the demonstrations, designed by hand
    33988      tasks in scenes of training families

What a user's seed stands for is a block of numbers (`SeedBlocks`): layouts of a training family, camera paths, tasks.
A camera path draws route, mounts and goals from NumPy, and its depth noise from JAX, both seeded by its one number.

Everything else starts from a user's seed alone, or from `mixed_seed`: the order of training frames (seed, epoch), a
robot's friction, masses and sensor noise (seed, robot), goals in the frames of episodes (seed, episode), networks and
states in training (a JAX key folded with the step). Such draws are of different kinds and may share their numbers; so
may the robots of two collections of episodes whose seeds are near each other, but not their tasks.
"""

from dataclasses import dataclass

import numpy as np

from iwalker_jax.errors import InputError

WORD = 2**32
"""A seed is one word of entropy; a larger number would count as two and could meet another draw."""

SEED_END = 2**31
"""Users' seeds stay below: JAX's keys take no more from an integer."""

FAMILY_LIMIT = 1000
"""Words below this belong to the training families."""


def check_seed(seed: int, what: str) -> None:
    """Refuse a user's seed that not every generator takes.

    Raises:
        InputError: unless it lies from 0 to 2^31 - 1, which every integer type holds.
    """
    if not isinstance(seed, (int, np.integer)) or not 0 <= seed < SEED_END:
        raise InputError(f"The seed of {what} is {seed!s:.40}; give a whole number from 0 to {SEED_END - 1}.")


@dataclass(frozen=True)
class Stream:
    """NumPy generators of one purpose.

    Attributes:
        key: first word of their entropy; no other stream has it.
    """

    key: int

    def generator(self, *numbers: int) -> np.random.Generator:
        """The generator of some numbers, as a seed and an attempt; always give as many.

        Raises:
            InputError: for a number that is negative or longer than a word.
        """
        for number in numbers:
            if not 0 <= number < WORD:
                raise InputError(f"{number} is no seed; give a whole number from 0 to {WORD - 1}.")
        return np.random.default_rng([self.key, *numbers])


def family_stream(family: int) -> Stream:
    """Layouts of the training family of a number: `generator(scene seed, attempt)`."""
    if not 0 <= family < FAMILY_LIMIT:
        raise InputError(f"{family} is no number of a training family; give one from 0 to {FAMILY_LIMIT - 1}.")
    return Stream(family)


HELD_OUT_SCENES = Stream(7_919)
"""Scenes that training never shows: `generator(scene seed, attempt)`."""

HELD_OUT_TASKS = Stream(16_180)
"""Tasks in them: `generator(task seed, attempt)`."""

SEQUENCE_FURNITURE = Stream(20_240)
"""Small dimensions of the held-out sequences' furniture: `generator(number of the sequence)`."""

NAMED_TASKS = Stream(27_182)
"""Tasks with names: `generator(*bytes of the name, seed, attempt)`.

A demonstration and a held-out sequence of one name draw alike, each in its own scene.
"""

DEMONSTRATION_FURNITURE = Stream(31_415)
"""Small dimensions of the demonstrations' furniture: `generator(number of the demonstration)`."""

TRAINING_TASKS = Stream(33_988)
"""Tasks in scenes of the training families: `generator(task seed, attempt)`."""

STREAMS = (
    HELD_OUT_SCENES,
    HELD_OUT_TASKS,
    SEQUENCE_FURNITURE,
    NAMED_TASKS,
    DEMONSTRATION_FURNITURE,
    TRAINING_TASKS,
)
"""All of the table but the families."""


@dataclass(frozen=True)
class SeedBlocks:
    """Successive numbers of one purpose, a block for each seed that a user gives.

    Attributes:
        what: is drawn, in the plural, for sentences.
        first: number of seed 0.
        size: numbers of each seed.
        end: the numbers stay below.
    """

    what: str
    first: int
    size: int
    end: int = WORD

    @property
    def seeds(self) -> int:
        """How many seeds have a whole block."""
        return (self.end - self.first) // self.size

    def number(self, seed: int, index: int = 0) -> int:
        """The number of a seed's draw `index`.

        Raises:
            InputError: for a negative seed, or one whose numbers belong to others; for an index beyond the block.
        """
        if not 0 <= seed < self.seeds:
            raise InputError(f"The seed of {self.what} must lie from 0 to {self.seeds - 1}, got {seed}.")
        if not 0 <= index < self.size:
            raise InputError(f"One seed covers {self.size} {self.what}, and more were asked for; ask for fewer.")
        return self.first + seed * self.size + index


TRAINING_LAYOUTS = SeedBlocks("layouts of a training family", 0, 100_000)
"""Scene seeds of training frames."""

UNSEEN_LAYOUTS = SeedBlocks("unseen scenes", 0, 10_000)
"""Scene seeds of the held-out scenes in which single frames are evaluated."""

SEQUENCE_PATHS = SeedBlocks("test sequences", 1_000_003, 1, end=2_000_003)
"""Camera paths along the routes of the held-out sequences."""

UNSEEN_PATHS = SeedBlocks("camera paths through unseen scenes", 2_000_003, 10_000, end=2**31)
"""Camera paths through those held-out scenes; 31 bits, which every integer type holds."""

STUDY_TASKS = SeedBlocks("tasks of a set", 0, 10_000)
"""Task seeds of a closed-loop study."""

COLLECTION_TASKS = SeedBlocks("episodes of a collection", 1_000_000, 1_000_000)
"""Task seeds of episodes that are collected as training frames."""


def mixed_seed(*numbers: int) -> int:
    """A 31-bit seed that several numbers determine; two combinations share one with a probability of 2^-31.

    Camera paths of training frames have those of (seed, family, layout), conditions of a study's episodes those of
    (seed, *bytes of the set's name, number of the first task).
    """
    return int(np.random.SeedSequence(list(numbers)).generate_state(1)[0] >> 1)
