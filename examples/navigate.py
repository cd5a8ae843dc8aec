"""One episode by sight, camera to torque: python examples/navigate.py [--task factory] [--policy default].

The robot sees a noisy depth image 15 times a second, plans a path and footsteps, and walks on its own state estimate
until it stands at its goal, gives up, falls or touches something.
"""

import dataclasses
from pathlib import Path

import iwalker_jax as iw

iw.configure_runtime()

import tyro

from iwalker_jax.evaluation.episodes import save_episode
from iwalker_jax.tasks import named_task


def main(
    task: str = "office", policy: str = "default", time_limit: float | None = None, out: Path = Path("runs/examples")
) -> None:
    """Walk one task and draw the way.

    Args:
        task: factory, corridor, office, test_stair, test_office, test_corridor or test_corner.
        policy: default, networks, published or classical.
        time_limit: [s] after which the episode ends; the task's own if left out.
        out: folder to write to.
    """
    chosen = named_task(task)
    chosen = chosen if time_limit is None else dataclasses.replace(chosen, time_limit=time_limit)
    result = iw.run_episodes(chosen, policy)
    metrics = result.metrics[0]
    print(f"{task}: {metrics.outcome.name} after {metrics.seconds:.1f} s and {metrics.walked:.2f} m")
    print(f"Least clearance {100 * metrics.clearance:.1f} cm, largest torque {100 * metrics.torque_peak:.0f} %")
    save_episode(chosen, result.records[0], out / "episode.png")
    print(f"The picture is {out / 'episode.png'}.")


if __name__ == "__main__":
    tyro.cli(main)
