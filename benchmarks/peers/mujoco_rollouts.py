"""C MuJoCo's own roll-outs of many robots under constant torques, in double precision, on some threads."""

from collections.abc import Callable

import mujoco
import numpy as np
from mujoco.rollout import Rollout


def rollout_call(
    model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, torques: np.ndarray, steps: int, threads: int
) -> Callable[[], np.ndarray]:
    """A call that moves all robots by some steps and returns their states, time left out.

    Args:
        model: of one robot.
        qpos, qvel: (B, nq), (B, nv) of the beginning.
        torques: (B, nu) [N m].
        steps: of the model's time step.
        threads: that share the robots.

    Returns:
        A function of nothing; its result is (B, nq + nv).
    """
    state = mujoco.mjtState.mjSTATE_FULLPHYSICS
    size = mujoco.mj_stateSize(model, state)
    first = np.zeros((len(qpos), size))
    first[:, 1 : 1 + model.nq + model.nv] = np.concatenate([qpos, qvel], axis=1)
    datas = [mujoco.MjData(model) for _ in range(threads)]
    controls = np.repeat(np.asarray(torques, float)[:, None], steps, axis=1)
    pool = Rollout(nthread=threads if threads > 1 else 0)

    def call() -> np.ndarray:
        states, _ = pool.rollout(model, datas, first, controls)
        return states[:, -1, 1 : 1 + model.nq + model.nv]

    return call
