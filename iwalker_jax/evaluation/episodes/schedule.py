"""What a closed-loop study runs: which policies, which tasks in which batches, and by what names results are kept."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes.log import EpisodeKey
from iwalker_jax.navigation import POLICIES, Outcome
from iwalker_jax.scenes import room_is_passable
from iwalker_jax.streams import STUDY_TASKS, check_seed, mixed_seed
from iwalker_jax.tasks import ROOM_TASK_NAMES, TASK_NAMES, Task, generated_tasks, named_task

GENERATED = "generated"
"""The set of episodes in scenes that training never shows."""

EPISODE_SETS: tuple[str, ...] = (GENERATED, *TASK_NAMES)
"""Names of all sets of episodes."""

ROOMS = "rooms"
"""All hard rooms, each a set of its own."""

NETWORKS_MARK = "@"
"""In a policy's name, before the name of the networks that it asks instead of the study's own."""


_WIDEST = 65_536


@dataclass(frozen=True)
class StudySettings:
    """What is run.

    Attributes:
        planner: name of the networks, for the log.
        policies: of `POLICIES`, followed by @ and a name where they ask other networks; episode_sets: of
            `EPISODE_SETS`.
        count: of generated episodes; seeds: of each other set.
        depth: noisy or ideal camera; state: estimated from sensors or true.
        seed: of tasks, robots and noise.
        width: episodes run at a time.
    """

    planner: str
    policies: tuple[str, ...] = tuple(POLICIES)
    episode_sets: tuple[str, ...] = (GENERATED, "factory", "corridor", "office")
    count: int = 200
    seeds: int = 10
    depth: Literal["noisy", "ideal"] = "noisy"
    state: Literal["estimated", "true"] = "estimated"
    seed: int = 0
    width: int = 20

    def __post_init__(self) -> None:
        kinds = tuple(policy_and_networks(policy)[0] for policy in self.policies)
        for title, given, names, known in (
            ("policy", self.policies, kinds, tuple(POLICIES)),
            ("set of episodes", self.episode_sets, self.episode_sets, EPISODE_SETS),
        ):
            unknown = [whole for whole, name in zip(given, names) if name not in known]
            if unknown or not given or len(set(given)) < len(given):
                raise InputError(
                    f"{', '.join(unknown or given) or 'No'}: choose each {title} once, of {', '.join(known)}."
                )
        for name, low in (("count", 1), ("seeds", 1), ("width", 1), ("seed", 0)):
            if getattr(self, name) < low:
                raise InputError(f"The study's {name} is {getattr(self, name)}; give at least {low}.")
        check_seed(self.seed, "the study")
        if self.width > _WIDEST:
            raise InputError(f"The study's width is {self.width}; give at most {_WIDEST} episodes at a time.")
        if max(self.count, self.seeds) > STUDY_TASKS.size:
            raise InputError(
                f"A set of more than {STUDY_TASKS.size} episodes was asked for; give smaller count and seeds."
            )

    def stem(self, policy: str, what: str | int) -> str:
        """A file name without its ending, of something of a policy; tells studies in one folder apart."""
        name, planner = self.who(policy)
        words = f"{name}-{what}-{planner}-{self.depth}-{self.state}-{self.seed}-{self.width}"
        return re.sub(r"[^\w.]+", "-", words)

    def who(self, policy: str) -> tuple[str, str]:
        """Name of a policy of `POLICIES`, and of the networks that it asks."""
        name, other = policy_and_networks(policy)
        return name, other or self.planner


def named_sets(names: Iterable[str]) -> tuple[str, ...]:
    """Sets of episodes by the names that a user gives: `ROOMS` stands for every hard room."""
    return tuple(each for name in names for each in (ROOM_TASK_NAMES if name == ROOMS else (name,)))


def expected_outcomes(episode_set: str) -> tuple[Outcome, ...]:
    """How an episode of a set ends if all goes well: in a room that cannot be walked through, the robot gives up."""
    if episode_set not in ROOM_TASK_NAMES:
        return (Outcome.REACHED,)
    passable = room_is_passable(episode_set.removeprefix("room_"))
    if passable is None:
        return (Outcome.REACHED, Outcome.GAVE_UP)
    return (Outcome.REACHED,) if passable else (Outcome.GAVE_UP,)


def policy_and_networks(policy: str) -> tuple[str, str]:
    """Name of a policy of `POLICIES`, and what is said of other networks than the study's own; empty if nothing."""
    name, _, other = policy.partition(NETWORKS_MARK)
    return name, other


class ScheduledEpisode(NamedTuple):
    """One task of a set of episodes and its number in the set."""

    episode_set: str
    number: int
    task: Task


class EpisodeBatch(NamedTuple):
    """Episodes of one set that are run at a time; which set, the number of the first, and the conditions' seed."""

    episode_set: str
    first: int
    episodes: tuple[ScheduledEpisode, ...]
    seed: int


def scheduled_episodes(settings: StudySettings) -> list[ScheduledEpisode]:
    """All episodes of a study, set by set; task k of a set is the same however many there are."""
    episodes = []
    for name in settings.episode_sets:
        if name == GENERATED:
            # Studies with other seeds have other tasks.
            tasks = generated_tasks(settings.count, STUDY_TASKS.number(settings.seed))
        else:
            tasks = [named_task(name, STUDY_TASKS.number(settings.seed, k)) for k in range(settings.seeds)]
        episodes += [ScheduledEpisode(name, number, task) for number, task in enumerate(tasks)]
    return episodes


def episode_batches(settings: StudySettings, episodes: Sequence[ScheduledEpisode]) -> list[EpisodeBatch]:
    """The episodes of a study in batches, each of one set: what a robot meets does not depend on the other sets."""
    batches = []
    for name in settings.episode_sets:
        own = [episode for episode in episodes if episode.episode_set == name]
        for first in range(0, len(own), settings.width):
            seed = conditions_seed(settings.seed, name, first)
            batches.append(EpisodeBatch(name, first, tuple(own[first : first + settings.width]), seed))
    return batches


def conditions_seed(seed: int, episode_set: str, first: int) -> int:
    """Seed of robots and noise of the batch that begins with a number of a set, in the study of a seed."""
    return mixed_seed(seed, *episode_set.encode(), first)


def episode_key(settings: StudySettings, policy: str, episode: ScheduledEpisode) -> EpisodeKey:
    """The log's key of an episode."""
    s = settings
    name, planner = s.who(policy)
    return EpisodeKey(planner, s.depth, s.state, s.seed, s.width, name, episode.episode_set, episode.number)
