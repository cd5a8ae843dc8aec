"""Closed-loop studies: every policy walks every set of tasks, batch by batch; a stopped study goes on where it was."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol

import jax

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes.film import FilmSettings, write_film
from iwalker_jax.evaluation.episodes.log import EpisodeKey, append_episodes, load_logs, log_file
from iwalker_jax.evaluation.episodes.metrics import EpisodeMetrics, episode_metrics, judged, row_of, shortest_route
from iwalker_jax.evaluation.episodes.tables import navigation_table
from iwalker_jax.evaluation.episodes.traces import draw_sheets, has_traces, save_traces, traces_file
from iwalker_jax.evaluation.episodes.walks import (
    Batch,
    StudySettings,
    Walk,
    batches_of,
    key_of,
    walks_of,
)
from iwalker_jax.navigation import EpisodeRecord
from iwalker_jax.runtime.processes import barrier, is_first
from iwalker_jax.tasks.task import Task

Groups = dict[tuple[str, str], list[EpisodeMetrics]]


class Program(Protocol):
    """Walks tasks to their ends, as `EpisodeProgram` does.

    Attributes:
        compile_seconds: [s] spent so far on compilation.
    """

    compile_seconds: float

    def run(
        self, tasks: Sequence[Task], seed: int = 0, *, on_progress: Callable[[float, int], None]
    ) -> EpisodeRecord: ...


MakeProgram = Callable[[str, int, bool], Program]
"""The program of a policy, for a number of episodes at a time, with images recorded or not."""


class Progress(NamedTuple):
    """How far a study is: episodes done of all, who walks, and how many of the batch are still on their way."""

    done: int
    total: int
    policy: str
    running: int


@dataclass
class Study:
    """What came of a study.

    Attributes:
        groups: figures of the episodes by policy and set of walks.
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
    def walking(self, program: Program) -> Iterator[None]:
        """Count the block's time as walking, but for what the program spends on compilation."""
        before = program.compile_seconds
        with self.timed("walking"):
            yield
        compiling = program.compile_seconds - before
        self.seconds["compiling"] = self.seconds.get("compiling", 0.0) + compiling
        self.seconds["walking"] -= compiling


def run_study(
    settings: StudySettings,
    make_program: MakeProgram,
    folder: Path,
    film: FilmSettings | None = FilmSettings(),
    on_progress: Callable[[Progress], None] = lambda progress: None,
    say: Callable[[str], None] = lambda sentence: None,
) -> Study:
    """Walk everything that the folder's log does not hold yet, and write log, tables, sheets and films.

    A batch of which an episode or a trace is missing is walked again, and comes out as before. After every batch the
    log episodes.csv has grown and the tables navigation.md and .csv are new. Of several processes each walks its share
    and logs it in a file of its own; they part at the end, and process 0 goes on alone to draw what all have walked.

    Args:
        settings: what is walked.
        make_program: compiles a policy.
        folder: of the results.
        film: how the first policy is filmed on the first task of every set; None for no films.
        on_progress: hears how far it is.
        say: hears of what is worth a sentence.

    Raises:
        InputError: a log of another version, files that cannot be written, or a process whose share is missing.
    """
    study = Study()
    with study.timed("making tasks"):
        walks = walks_of(settings)
        batches = batches_of(settings, walks)
    process, processes = jax.process_index(), jax.process_count()
    log = log_file(folder, process)
    known = load_logs(folder)
    # Shares of all batches, not of those left: the logs grow while other processes start.
    share = [(policy, batch) for policy in settings.policies for batch in batches][process::processes]
    todo = [(policy, batch) for policy, batch in share if not _finished(settings, policy, batch, known, folder)]
    if len(todo) < len(share):
        say(f"{len(share) - len(todo)} of {len(share)} batches are in {folder} already.")
    done, total = 0, sum(len(batch.members) for _, batch in todo)
    shortest: dict[tuple[str, int], float] = {}
    program: Program | None = None
    for position, (policy, batch) in enumerate(todo):
        if position == 0 or policy != todo[position - 1][0]:
            with study.timed("building policies"):
                program = make_program(policy, settings.width, False)
        assert program is not None
        size, limit = len(batch.members), sum(walk.task.time_limit for walk in batch.members)

        def report(seconds: float, running: int, done=done, size=size, limit=limit, policy=policy) -> None:
            on_progress(Progress(done + int(size * min(seconds / limit, 0.99)), total, policy, running))

        on_progress(Progress(done, total, policy, size))
        with study.walking(program):
            record = program.run([walk.task for walk in batch.members], batch.seed, on_progress=report)
        with study.timed("figures, tables and sheets"):
            rows = []
            for i, walk in enumerate(batch.members):
                which = walk.walks, walk.number
                if which not in shortest:
                    shortest[which] = shortest_route(walk.task)
                metrics = episode_metrics(row_of(record, i), walk.task, shortest[which])
                rows.append((key_of(settings, policy, walk), walk.task.name, metrics))
            save_traces(traces_file(folder, settings, policy, batch), record)
            append_episodes(log, rows)
            if is_first():
                navigation_table(grouped(settings, walks, load_logs(folder))).save(folder, "navigation")
        done += size
        on_progress(Progress(done, total, policy, 0))
    barrier()
    if not is_first():
        return study
    known = load_logs(folder)
    missing = [
        policy
        for policy in settings.policies
        if not all(_finished(settings, policy, batch, known, folder) for batch in batches)
    ]
    if missing:
        raise InputError(
            f"{folder} lacks walks of {', '.join(missing)}; give all processes this same folder and the same options."
        )
    study.groups = grouped(settings, walks, known)
    with study.timed("figures, tables and sheets"):
        navigation_table(study.groups).save(folder, "navigation")
        study.sheets = draw_sheets(settings, batches, folder)
    if film is not None:
        study.films = make_films(settings, batches, make_program, folder, film, study, say)
    return study


def grouped(settings: StudySettings, walks: Sequence[Walk], known: Mapping[EpisodeKey, EpisodeMetrics]) -> Groups:
    """The study's episodes among those known, by policy and set of walks; sets without any are left out."""
    groups: Groups = {}
    for name in settings.walks:
        for policy in settings.policies:
            keys = [key_of(settings, policy, walk) for walk in walks if walk.walks == name]
            episodes = [known[key] for key in keys if key in known]
            if episodes:
                groups[policy, name] = episodes
    return groups


def _finished(
    settings: StudySettings, policy: str, batch: Batch, known: Mapping[EpisodeKey, EpisodeMetrics], folder: Path
) -> bool:
    """Whether the folder holds figures and traces of a policy's whole batch."""
    logged = all(key_of(settings, policy, walk) in known for walk in batch.members)
    return logged and has_traces(traces_file(folder, settings, policy, batch), len(batch.members))


def make_films(
    settings: StudySettings,
    batches: Sequence[Batch],
    make_program: MakeProgram,
    folder: Path,
    film: FilmSettings,
    study: Study,
    say: Callable[[str], None],
) -> list[tuple[str, Path]]:
    """Films of the first policy's first episode of every set; those there already are kept.

    Each is walked by itself in the conditions of its batch: it is the tables' episode, whatever else is filmed.
    """
    policy = settings.policies[0]
    starring = [batch for batch in batches if batch.first == 0]
    files = [folder / "films" / f"{settings.stem(policy, batch.walks)}.webm" for batch in starring]
    missing = [(file, batch) for file, batch in zip(files, starring) if not file.exists()]
    if missing:
        say(f"Walking {len(missing)} episodes again, with images, for the films.")
        with study.timed("building policies"):
            program = make_program(policy, 1, True)
    for file, batch in missing:
        task = batch.members[0].task
        with study.walking(program):
            record = program.run([task], batch.seed, on_progress=lambda seconds, running: None)
        with study.timed("drawing films"):
            try:
                write_film(file, task, judged(row_of(record, 0), task), film)
            except InputError as error:
                say(f"No film: {error}")
    titles = [f"{policy}, {batch.walks}" for batch in starring]
    return [(title, file) for title, file in zip(titles, files) if file.exists()]
