"""What a closed-loop study walks: which policies, which tasks, and by what names its results are kept."""

import re
from dataclasses import dataclass
from typing import Literal, NamedTuple

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episode_log import EpisodeKey
from iwalker_jax.navigation.demonstrations import TASK_NAMES, named_task
from iwalker_jax.navigation.generated_tasks import generated_tasks
from iwalker_jax.navigation.navigators import POLICIES
from iwalker_jax.navigation.task import Task

GENERATED = "generated"
"""The set of walks in scenes that training never shows."""

WALKS: tuple[str, ...] = (GENERATED, *TASK_NAMES)

OF = "@"
"""In a policy's name, before the name of the networks that it asks instead of the study's own."""

SEEDS_APART = 10_000
"""Between the seeds of two studies; every batch of a study has one of its own."""


@dataclass(frozen=True)
class StudySettings:
    """What is walked.

    Attributes:
        planner: name of the networks, for the log.
        policies: of `POLICIES`, followed by @ and a name where they ask other networks; walks: of `WALKS`.
        count: of generated walks; seeds: of each other set of walks.
        depth: noisy or ideal camera; state: estimated from sensors or true.
        seed: of tasks, robots and noise.
        width: episodes walked at a time.
    """

    planner: str
    policies: tuple[str, ...] = tuple(POLICIES)
    walks: tuple[str, ...] = (GENERATED, "factory", "corridor", "office")
    count: int = 200
    seeds: int = 10
    depth: Literal["noisy", "ideal"] = "noisy"
    state: Literal["estimated", "true"] = "estimated"
    seed: int = 0
    width: int = 20

    def __post_init__(self) -> None:
        for title, given, known in (("policy", self.policies, tuple(POLICIES)), ("set of walks", self.walks, WALKS)):
            unknown = [name for name in given if name.partition(OF)[0] not in known]
            if unknown or not given or len(set(given)) < len(given):
                raise InputError(
                    f"{', '.join(unknown or given) or 'No'}: choose each {title} once, of {', '.join(known)}."
                )
        for name, low in (("count", 1), ("seeds", 1), ("width", 1), ("seed", 0)):
            if getattr(self, name) < low:
                raise InputError(f"The study's {name} is {getattr(self, name)}; give at least {low}.")

    def stem(self, policy: str, what: str | int) -> str:
        """A file name without its ending, of something of a policy; tells studies in one folder apart."""
        words = f"{policy}-{what}-{self.planner}-{self.depth}-{self.state}-{self.seed}-{self.width}"
        return re.sub(r"[^\w.]+", "-", words)


class Walk(NamedTuple):
    """One task of a set of walks and its number in the set."""

    walks: str
    number: int
    task: Task


def walks_of(settings: StudySettings) -> list[Walk]:
    """All tasks of a study, set by set."""
    walks = []
    for name in settings.walks:
        if name == GENERATED:
            # Studies with other seeds walk elsewhere.
            tasks = generated_tasks(settings.count, settings.seed * SEEDS_APART)
        else:
            tasks = [named_task(name, settings.seed * settings.seeds + k) for k in range(settings.seeds)]
        walks += [Walk(name, number, task) for number, task in enumerate(tasks)]
    return walks


def key_of(settings: StudySettings, policy: str, walk: Walk) -> EpisodeKey:
    """The log's key of an episode."""
    s = settings
    name, _, other = policy.partition(OF)
    return EpisodeKey(other or s.planner, s.depth, s.state, s.seed, s.width, name, walk.walks, walk.number)
