"""Closed-loop studies: every policy walks every set of tasks, batch by batch; a stopped study goes on where it was."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol

import jax

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episode_log import EpisodeKey, append_episodes, load_logs, log_file
from iwalker_jax.evaluation.navigation_film import FilmSettings, write_film
from iwalker_jax.evaluation.navigation_metrics import EpisodeMetrics, episode_metrics, row_of, shortest_route
from iwalker_jax.evaluation.navigation_tables import navigation_table
from iwalker_jax.evaluation.navigation_traces import draw_sheets, save_traces, traces_file
from iwalker_jax.evaluation.navigation_walks import SEEDS_APART, StudySettings, Walk, key_of, walks_of
from iwalker_jax.navigation.task import EpisodeRecord, Task
from iwalker_jax.processes import is_first, part

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

    After every batch the log episodes.csv has grown and the tables navigation.md and .csv are new. Of several
    processes each walks its share and logs it in a file of its own; they part at the end, and process 0 goes on alone
    to draw what all have walked.

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
    process, processes = jax.process_index(), jax.process_count()
    log = log_file(folder, process)
    known = load_logs(folder)
    batches = [(policy, k) for policy in settings.policies for k in range(0, len(walks), settings.width)]
    # Shares of all batches, not of those left: the logs grow while other processes start.
    batches = batches[process::processes]
    todo = [(p, k) for p, k in batches if not _finished(settings, p, walks[k : k + settings.width], known)]
    if len(todo) < len(batches):
        say(f"{len(batches) - len(todo)} of {len(batches)} batches are in {folder} already.")
    done, total = 0, sum(len(walks[k : k + settings.width]) for _, k in todo)
    shortest: dict[int, float] = {}
    program: Program | None = None
    for position, (policy, first) in enumerate(todo):
        if position == 0 or policy != todo[position - 1][0]:
            with study.timed("building policies"):
                program = make_program(policy, settings.width, False)
        assert program is not None
        batch = walks[first : first + settings.width]
        limit = sum(walk.task.time_limit for walk in batch)

        def report(seconds: float, running: int, done=done, size=len(batch), limit=limit, policy=policy) -> None:
            on_progress(Progress(done + int(size * min(seconds / limit, 0.99)), total, policy, running))

        on_progress(Progress(done, total, policy, len(batch)))
        seed = settings.seed * SEEDS_APART + first // settings.width
        with study.walking(program):
            record = program.run([walk.task for walk in batch], seed, on_progress=report)
        with study.timed("figures, tables and sheets"):
            for i in range(first, first + len(batch)):
                shortest.setdefault(i, shortest_route(walks[i].task))
            rows = []
            for i, walk in enumerate(batch):
                metrics = episode_metrics(row_of(record, i), walk.task, shortest[first + i])
                rows.append((key_of(settings, policy, walk), walk.task.name, metrics))
            save_traces(traces_file(folder, settings, policy, first), record)
            append_episodes(log, rows)
            if is_first():
                navigation_table(grouped(settings, walks, load_logs(folder))).save(folder, "navigation")
        done += len(batch)
        on_progress(Progress(done, total, policy, 0))
    part()
    if not is_first():
        return study
    known = load_logs(folder)
    missing = [policy for policy in settings.policies if not _finished(settings, policy, walks, known)]
    if missing:
        raise InputError(
            f"{folder} lacks walks of {', '.join(missing)}; give all processes this same folder and the same options."
        )
    study.groups = grouped(settings, walks, known)
    with study.timed("figures, tables and sheets"):
        navigation_table(study.groups).save(folder, "navigation")
        study.sheets = draw_sheets(settings, walks, folder)
    if film is not None:
        study.films = make_films(settings, walks, make_program, folder, film, study, say)
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
    settings: StudySettings, policy: str, batch: Sequence[Walk], known: Mapping[EpisodeKey, EpisodeMetrics]
) -> bool:
    return all(key_of(settings, policy, walk) in known for walk in batch)


def make_films(
    settings: StudySettings,
    walks: Sequence[Walk],
    make_program: MakeProgram,
    folder: Path,
    film: FilmSettings,
    study: Study,
    say: Callable[[str], None],
) -> list[tuple[str, Path]]:
    """Films of the first policy on the first task of every set; those there already are kept."""
    policy = settings.policies[0]
    starring = [walk for walk in walks if walk.number == 0]
    files = [folder / "films" / f"{settings.stem(policy, walk.walks)}.webm" for walk in starring]
    if not all(file.exists() for file in files):
        say(f"Walking {len(starring)} episodes again, with images, for the films.")
        with study.timed("building policies"):
            program = make_program(policy, len(starring), True)
        tasks = [walk.task for walk in starring]
        with study.walking(program):
            record = program.run(tasks, settings.seed * SEEDS_APART, on_progress=lambda seconds, running: None)
        with study.timed("drawing films"):
            for i, file in enumerate(files):
                try:
                    write_film(file, tasks[i], row_of(record, i), film)
                except InputError as error:
                    say(f"No film: {error}")
    titles = [f"{policy}, {walk.walks}" for walk in starring]
    return [(title, file) for title, file in zip(titles, files) if file.exists()]
