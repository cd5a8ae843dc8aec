"""Closed-loop studies: every policy runs every set of episodes in batches; a stopped study goes on where it was.

The batches of a policy are walked in one run, in which no robot waits for the others of its batch.
"""

import itertools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol, runtime_checkable

import jax

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes.film import FilmSettings, write_film
from iwalker_jax.evaluation.episodes.log import EpisodeKey, append_episodes, load_logs, log_file
from iwalker_jax.evaluation.episodes.metrics import EpisodeMetrics, episode_metrics, judged, row_of, shortest_route
from iwalker_jax.evaluation.episodes.schedule import (
    EpisodeBatch,
    ScheduledEpisode,
    StudySettings,
    episode_batches,
    episode_key,
    scheduled_episodes,
)
from iwalker_jax.evaluation.episodes.tables import episode_table
from iwalker_jax.evaluation.episodes.traces import draw_sheets, has_traces, save_traces, traces_file
from iwalker_jax.navigation import EpisodeRecord, RunProgress, TaskBatch
from iwalker_jax.runtime import barrier, is_first
from iwalker_jax.runtime.locks import exclusive
from iwalker_jax.tasks import Task

Groups = dict[tuple[str, str], list[EpisodeMetrics]]


@runtime_checkable
class EpisodeRunner(Protocol):
    """Runs tasks to their ends, as `EpisodeProgram` does.

    Attributes:
        compile_seconds: [s] spent so far on compilation.
    """

    compile_seconds: float

    def run(
        self, tasks: Sequence[Task], seed: int = 0, *, on_progress: Callable[[float, int], None]
    ) -> EpisodeRecord: ...

    def run_batches(
        self, batches: Sequence[TaskBatch], on_progress: Callable[[RunProgress], None]
    ) -> Iterator[tuple[int, EpisodeRecord]]: ...


MakeRunner = Callable[[str, int, bool], EpisodeRunner]
"""What runs a policy, for a number of episodes at a time, with images recorded or not."""

PolicyBatches = Sequence[tuple[str, EpisodeBatch]]
"""Batches of episodes with the policy of each."""

_TABLE = "episode_table"
_FIGURES = "figures, tables and sheets"


class StudyProgress(NamedTuple):
    """How far a study is: episodes done of all, whose policy, and how many are under way."""

    done: int
    total: int
    policy: str
    running: int


@dataclass
class Study:
    """What came of a study.

    Attributes:
        groups: figures of the episodes by policy and set of episodes.
        sheets, films: (title, file) of the pictures and videos.
        seconds: [s] by what they were spent on.
    """

    groups: Groups = field(default_factory=dict)
    sheets: list[tuple[str, Path]] = field(default_factory=list)
    films: list[tuple[str, Path]] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def timed(self, purpose: str) -> Iterator[None]:
        """Count the block's time."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[purpose] = self.seconds.get(purpose, 0.0) + time.perf_counter() - began

    @contextmanager
    def running(self, runner: EpisodeRunner) -> Iterator[None]:
        """Count the block's time as running episodes, but for what the runner spends on compilation."""
        before = runner.compile_seconds
        with self.timed("running episodes"):
            yield
        compiling = runner.compile_seconds - before
        self.seconds["compiling"] = self.seconds.get("compiling", 0.0) + compiling
        self.seconds["running episodes"] -= compiling

    def finished_batches(
        self, runner: EpisodeRunner, batches: Sequence[TaskBatch], on_progress: Callable[[RunProgress], None]
    ) -> Iterator[tuple[int, EpisodeRecord]]:
        """What `run_batches` hands out; the time between two of them counts as running episodes."""
        finished = runner.run_batches(batches, on_progress)
        while True:
            with self.running(runner):
                one = next(finished, None)
            if one is None:
                return
            yield one


def run_episode_study(
    settings: StudySettings,
    make_runner: MakeRunner,
    folder: Path,
    film: FilmSettings | None = FilmSettings(),
    on_progress: Callable[[StudyProgress], None] = lambda progress: None,
    say: Callable[[str], None] = lambda sentence: None,
) -> Study:
    """Run every episode that the folder's log does not hold yet, and write log, tables, sheets and films.

    A batch of which an episode or a trace is missing is run again, and comes out as before. When the last episode of a
    batch has ended, the log episodes.csv grows and the table episode_table is written anew. Of several processes each
    runs its share and logs it in a file of its own; they part at the end, and process 0 goes on alone to draw what all
    have run.

    Args:
        settings: what is run.
        make_runner: compiles a policy.
        folder: of the results.
        film: how the first policy is filmed on the first task of every set; None for no films.
        on_progress: hears how far it is.
        say: hears of what is worth a sentence.

    Raises:
        InputError: a folder in use, a log of another version, files that cannot be written, or a process whose share
            is missing.
    """
    study = Study()
    with study.timed("making tasks"):
        episodes = scheduled_episodes(settings)
        batches = episode_batches(settings, episodes)
    # A lock for each process of a group: they share the folder, and another command must not.
    log = log_file(folder, jax.process_index())
    with exclusive(log.with_suffix(".lock"), folder):
        known = load_logs(folder)
        # Shares of all batches, not of those left: the logs grow while other processes start.
        share = [(policy, batch) for policy in settings.policies for batch in batches]
        share = share[jax.process_index() :: jax.process_count()]
        todo = [(policy, batch) for policy, batch in share if not _finished(settings, policy, batch, known, folder)]
        if len(todo) < len(share):
            say(f"{len(share) - len(todo)} of {len(share)} batches are in {folder} already.")

        def save_table() -> None:
            if is_first():
                episode_table(grouped(settings, episodes, load_logs(folder))).save(folder, _TABLE)

        run_batches(study, settings, todo, make_runner, folder, save_table, on_progress)
        barrier()
        if not is_first():
            return study
        known = load_logs(folder)
        _require_all(settings, batches, known, folder)
        study.groups = grouped(settings, episodes, known)
        with study.timed(_FIGURES):
            save_table()
            study.sheets = draw_sheets(settings, batches, folder)
        if film is not None:
            study.films = make_films(settings, batches, make_runner, folder, film, study, say)
        return study


def run_batches(
    study: Study,
    settings: StudySettings,
    todo: PolicyBatches,
    make_runner: MakeRunner,
    folder: Path,
    save_table: Callable[[], None],
    on_progress: Callable[[StudyProgress], None],
) -> None:
    """Run batches; as soon as one has ended, its traces and its lines in this process's log are in the folder.

    Args:
        study: whose times are counted.
        settings: of the study.
        todo: what to run, the batches of a policy one after the other.
        make_runner: compiles a policy, once for all its batches.
        folder: of traces and log.
        save_table: is called after each batch.
        on_progress: hears how far it is.
    """
    log = log_file(folder, jax.process_index())
    done, total = 0, sum(len(batch.episodes) for _, batch in todo)
    shortest: dict[tuple[str, int], float] = {}
    for policy, pairs in itertools.groupby(todo, key=lambda pair: pair[0]):
        own = [batch for _, batch in pairs]
        with study.timed("building policies"):
            runner = make_runner(policy, settings.width, False)
        begun = StudyProgress(done, total, policy, max(len(batch.episodes) for batch in own))
        on_progress(begun)

        def report(progress: RunProgress, begun: StudyProgress = begun) -> None:
            on_progress(begun._replace(done=begun.done + progress.ended, running=progress.running))

        given = [TaskBatch([episode.task for episode in batch.episodes], batch.seed) for batch in own]
        for number, record in study.finished_batches(runner, given, report):
            batch = own[number]
            with study.timed(_FIGURES):
                save_traces(traces_file(folder, settings, policy, batch), record)
                append_episodes(log, _log_rows(settings, policy, batch, record, shortest))
                save_table()
            done += len(batch.episodes)
        on_progress(StudyProgress(done, total, policy, 0))


def _log_rows(
    settings: StudySettings,
    policy: str,
    batch: EpisodeBatch,
    record: EpisodeRecord,
    shortest: dict[tuple[str, int], float],
) -> list[tuple[EpisodeKey, str, EpisodeMetrics]]:
    """What is logged of a batch; the shortest routes [m] are kept by set and number, as all policies have the same."""
    rows = []
    for i, episode in enumerate(batch.episodes):
        which = episode.episode_set, episode.number
        if which not in shortest:
            shortest[which] = shortest_route(episode.task)
        metrics = episode_metrics(row_of(record, i), episode.task, shortest[which])
        rows.append((episode_key(settings, policy, episode), episode.task.name, metrics))
    return rows


def grouped(
    settings: StudySettings, episodes: Sequence[ScheduledEpisode], known: Mapping[EpisodeKey, EpisodeMetrics]
) -> Groups:
    """The study's episodes among those known, by policy and set of episodes; sets without any are left out."""
    groups: Groups = {}
    for name in settings.episode_sets:
        for policy in settings.policies:
            keys = [episode_key(settings, policy, episode) for episode in episodes if episode.episode_set == name]
            found = [known[key] for key in keys if key in known]
            if found:
                groups[policy, name] = found
    return groups


def _finished(
    settings: StudySettings, policy: str, batch: EpisodeBatch, known: Mapping[EpisodeKey, EpisodeMetrics], folder: Path
) -> bool:
    """Whether the folder holds figures and traces of a policy's whole batch."""
    logged = all(episode_key(settings, policy, episode) in known for episode in batch.episodes)
    return logged and has_traces(traces_file(folder, settings, policy, batch), len(batch.episodes))


def _require_all(
    settings: StudySettings,
    batches: Sequence[EpisodeBatch],
    known: Mapping[EpisodeKey, EpisodeMetrics],
    folder: Path,
) -> None:
    missing = [
        policy
        for policy in settings.policies
        if not all(_finished(settings, policy, batch, known, folder) for batch in batches)
    ]
    if missing:
        raise InputError(
            f"{folder} lacks episodes of {', '.join(missing)}; give all processes this same folder and the same "
            "options."
        )


def make_films(
    settings: StudySettings,
    batches: Sequence[EpisodeBatch],
    make_runner: MakeRunner,
    folder: Path,
    film: FilmSettings,
    study: Study,
    say: Callable[[str], None],
) -> list[tuple[str, Path]]:
    """Films of the first policy's first episode of every set; those there already are kept.

    Each is run by itself in the conditions of its batch: it is the tables' episode, whatever else is filmed.
    """
    policy = settings.policies[0]
    starring = [batch for batch in batches if batch.first == 0]
    files = [folder / "films" / f"{settings.stem(policy, batch.episode_set)}.webm" for batch in starring]
    missing = [(file, batch) for file, batch in zip(files, starring) if not file.exists()]
    if missing:
        say(f"Running {len(missing)} episodes again, with images, for the films.")
        with study.timed("building policies"):
            runner = make_runner(policy, 1, True)
    for file, batch in missing:
        task = batch.episodes[0].task
        with study.running(runner):
            record = runner.run([task], batch.seed, on_progress=lambda seconds, running: None)
        with study.timed("drawing films"):
            try:
                write_film(file, task, judged(row_of(record, 0), task), film)
            except InputError as error:
                say(f"No film: {error}")
    titles = [f"{policy}, {batch.episode_set}" for batch in starring]
    return [(title, file) for title, file in zip(titles, files) if file.exists()]
