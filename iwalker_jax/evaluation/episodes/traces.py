"""What is kept of a study's episodes to look at: traces on disk, and the sheets from above drawn from them."""

from collections.abc import Sequence
from pathlib import Path

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes.metrics import judged, row_of
from iwalker_jax.evaluation.episodes.pictures import save_episode_grid
from iwalker_jax.evaluation.episodes.schedule import EpisodeBatch, StudySettings
from iwalker_jax.navigation import EpisodeRecord, Outcome
from iwalker_jax.runtime import read_npz, write_npz
from iwalker_jax.tasks import Task

_PANELS = 16  # episodes on a sheet


def traces_file(folder: Path, settings: StudySettings, policy: str, batch: EpisodeBatch) -> Path:
    """Where the traces of a policy's batch are kept."""
    return folder / "traces" / f"{settings.stem(policy, f'{batch.episode_set}-{batch.first}')}.npz"


def save_traces(file: Path, record: EpisodeRecord) -> None:
    """Write what pictures from above need of a batch of episodes; of plans and postures only the last."""
    small = record._replace(
        **{name: getattr(record, name)[:, -1:] for name in ("qpos", "path", "footsteps")},
        **{name: getattr(record, name)[:, :0] for name in ("depth", "cells")},
    )
    write_npz(file, small._asdict())


def has_traces(file: Path, episodes: int) -> bool:
    """Whether a file is whole and holds the traces of so many episodes, or of more."""
    try:
        arrays = read_npz(file)
    except InputError:
        return False
    return set(EpisodeRecord._fields) <= set(arrays) and len(arrays["outcome"]) >= episodes


def load_traces(file: Path) -> EpisodeRecord:
    """What `save_traces` wrote; InputError if the file is damaged or another version wrote it."""
    try:
        arrays = read_npz(file)
    except InputError as error:
        raise InputError(f"{error}; delete it, and the same command runs its episodes again.") from error
    missing = [name for name in EpisodeRecord._fields if name not in arrays]
    if missing:
        raise InputError(f"{file} is of another version ({missing[0]} is missing); choose another folder.")
    return EpisodeRecord._make(arrays[name] for name in EpisodeRecord._fields)


def draw_sheets(settings: StudySettings, batches: Sequence[EpisodeBatch], folder: Path) -> list[tuple[str, Path]]:
    """One sheet of traces a policy and set of episodes, failures first, from the folder's traces of all batches."""
    sheets = []
    for policy in settings.policies:
        found: dict[str, list[tuple[Task, EpisodeRecord]]] = {}
        for batch in batches:
            record = load_traces(traces_file(folder, settings, policy, batch))
            for i, scheduled in enumerate(batch.episodes):
                episode = judged(row_of(record, i), scheduled.task)
                found.setdefault(batch.episode_set, []).append((scheduled.task, episode))
        for name, episodes in found.items():
            # A stable sort: within failures and successes the order of the tasks stays.
            chosen = sorted(episodes, key=lambda pair: pair[1].outcome[-1] == Outcome.REACHED)[:_PANELS]
            rest = f", {len(chosen)} of {len(episodes)} episodes, failures first" if len(chosen) < len(episodes) else ""
            title = f"{policy}, {name}{rest}"
            file = folder / "sheets" / f"{settings.stem(policy, name)}.png"
            save_episode_grid([task for task, _ in chosen], [episode for _, episode in chosen], file, title)
            sheets.append((title, file))
    return sheets
