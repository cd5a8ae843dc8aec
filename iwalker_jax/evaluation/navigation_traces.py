"""What is kept of a study's episodes to look at: traces on disk, and the sheets from above drawn from them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.navigation_metrics import row_of
from iwalker_jax.evaluation.navigation_pictures import save_episode_grid
from iwalker_jax.evaluation.navigation_walks import StudySettings, Walk
from iwalker_jax.navigation.task import EpisodeRecord, Outcome, Task

_PANELS = 16  # episodes on a sheet


def traces_file(folder: Path, settings: StudySettings, policy: str, first: int) -> Path:
    """Where the traces of the batch that begins with a walk are kept."""
    return folder / "traces" / f"{settings.stem(policy, first)}.npz"


def save_traces(file: Path, record: EpisodeRecord) -> None:
    """Write what pictures from above need of a batch of episodes; of plans and postures only the last."""
    small = record._replace(
        **{name: getattr(record, name)[:, -1:] for name in ("qpos", "path", "footsteps")},
        **{name: getattr(record, name)[:, :0] for name in ("depth", "occupied")},
    )
    file.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(file, allow_pickle=False, **{k: np.asarray(v) for k, v in small._asdict().items()})


def load_traces(file: Path) -> EpisodeRecord:
    """What `save_traces` wrote; InputError if another version did."""
    with np.load(file) as stored:
        missing = [name for name in EpisodeRecord._fields if name not in stored.files]
        if missing:
            raise InputError(f"{file} is of another version ({missing[0]} is missing); choose another folder.")
        return EpisodeRecord(**{name: stored[name] for name in EpisodeRecord._fields})


def draw_sheets(settings: StudySettings, walks: Sequence[Walk], folder: Path) -> list[tuple[str, Path]]:
    """One sheet of traces a policy and set of walks, failures first, from the folder's traces."""
    sheets = []
    for policy in settings.policies:
        found: dict[str, list[tuple[Task, EpisodeRecord]]] = {}
        for first in range(0, len(walks), settings.width):
            file = traces_file(folder, settings, policy, first)
            if not file.exists():
                continue
            record = load_traces(file)
            for i, walk in enumerate(walks[first : first + settings.width]):
                found.setdefault(walk.walks, []).append((walk.task, row_of(record, i)))
        for name, episodes in found.items():
            # A stable sort: within failures and successes the order of the tasks stays.
            chosen = sorted(episodes, key=lambda pair: int(pair[1].outcome[-1]) == Outcome.REACHED)[:_PANELS]
            rest = f", {len(chosen)} of {len(episodes)} episodes, failures first" if len(chosen) < len(episodes) else ""
            title = f"{policy}, {name}{rest}"
            file = folder / "sheets" / f"{settings.stem(policy, name)}.png"
            save_episode_grid([task for task, _ in chosen], [episode for _, episode in chosen], file, title)
            sheets.append((title, file))
    return sheets
