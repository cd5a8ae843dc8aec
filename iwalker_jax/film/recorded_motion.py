"""Recorded motions of a MuJoCo model: checked, resampled in time and smoothed."""

import mujoco
import numpy as np
from jaxtyping import Float

from iwalker_jax.errors import InputError


def check_motion(model: mujoco.MjModel, qpos: Float[np.ndarray, "n nq"], times: Float[np.ndarray, " n"]) -> None:
    """Raise InputError unless a motion fits the model, is finite and its times [s] increase."""
    if np.ndim(qpos) != 2 or np.shape(qpos)[1] != model.nq or np.shape(times) != np.shape(qpos)[:1]:
        raise InputError(
            f"The motion has qpos {np.shape(qpos)} and times {np.shape(times)}; "
            f"give (N, {model.nq}) and (N,) for this model."
        )
    bad = np.flatnonzero(~np.isfinite(qpos).all(axis=1))
    if len(bad):
        raise InputError(f"The motion's qpos is not finite from row {bad[0]} on; cut it off there.")
    if len(times) < 2 or not np.all(np.diff(times) > 0):
        raise InputError("The motion's times do not increase; give at least two instants in order.")


def resample_motion(
    model: mujoco.MjModel,
    qpos: Float[np.ndarray, "n nq"],
    times: Float[np.ndarray, " n"],
    at: Float[np.ndarray, " m"],
) -> Float[np.ndarray, "m nq"]:
    """Configurations (M, nq) at other times [s]: linear, quaternions normalised and along the shorter arc."""
    right = np.clip(np.searchsorted(times, at, side="right"), 1, len(times) - 1)
    weight = np.clip((at - times[right - 1]) / (times[right] - times[right - 1]), 0.0, 1.0)[:, None]
    before, after = np.asarray(qpos[right - 1], np.float64), np.array(qpos[right], np.float64)
    quaternions = [slice(a, a + 4) for a in _quaternion_addresses(model)]
    for part in quaternions:
        opposite = np.sum(before[:, part] * after[:, part], axis=1) < 0
        after[opposite, part] *= -1
    result = (1.0 - weight) * before + weight * after
    for part in quaternions:
        result[:, part] /= np.linalg.norm(result[:, part], axis=1, keepdims=True)
    return result


def smooth_track(points: Float[np.ndarray, "n d"], period: float, deviation: float = 0.25) -> Float[np.ndarray, "n d"]:
    """Points (N, d) [m] sampled every `period` [s], smoothed in time by a Gaussian of the given deviation [s].

    A quarter of a second takes out the sway of single steps and keeps turns. The ends are continued
    point-symmetrically, so a steady motion stays what it is.
    """
    reach = min(int(np.ceil(3 * deviation / period)), len(points) - 1)
    if reach < 1:
        return points
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * period / deviation) ** 2)
    kernel /= kernel.sum()
    padded = np.pad(points, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    return np.stack([np.convolve(column, kernel, mode="valid") for column in padded.T], axis=1)


def _quaternion_addresses(model: mujoco.MjModel) -> list[int]:
    """Where quaternions begin in qpos."""
    shift = {int(mujoco.mjtJoint.mjJNT_FREE): 3, int(mujoco.mjtJoint.mjJNT_BALL): 0}
    kinds, addresses = model.jnt_type.tolist(), model.jnt_qposadr.tolist()
    return [address + shift[kind] for kind, address in zip(kinds, addresses, strict=True) if kind in shift]
