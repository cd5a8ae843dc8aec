"""Figures of recorded walks: speed, footstep, heading and COM errors, torques, falls, estimation error. NumPy only."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from iwalker_jax.control import FootstepPlan
from iwalker_jax.geometry import host, side_of_step
from iwalker_jax.walking import Sample, TimedFootsteps, WalkRecord

_AT_REST = 0.04  # [s] after touchdown at which the landed foot is read
_ARM = 0.05  # [m] from the robot's middle to a foot
_STEADY = 0.95  # share of the longest planned advance from which a step counts as steady


class Landings(NamedTuple):
    """What was made of each planned footstep; NaN (touchdown -1) where none was.

    Attributes:
        touchdown: (K,) sample in which the step clock advanced; times: (K,) [s].
        feet: (K, 3) x, y [m] and yaw [rad] of the landed foot at rest.
    """

    touchdown: Int[np.ndarray, " k"]
    times: Float[np.ndarray, " k"]
    feet: Float[np.ndarray, "k 3"]


@dataclass(frozen=True)
class WalkMetrics:
    """Figures of one robot's walk, up to its fall if it fell.

    Attributes:
        fallen: it fell or broke; seconds: [s] until then or the end.
        steps: footsteps made, planned: in the plan.
        speed: [m/s] achieved between the touchdowns of the steady part, along the planned way; NaN without any.
        planned_speed: [m/s] of the plan there, by the nominal step time.
        turn_rate, planned_turn_rate: [rad/s] likewise.
        footstep_errors: (n,) [m] landed to planned foot, of the footsteps made.
        yaw_errors: (n,) [rad] absolute.
        heading_errors: (n - 1,) [rad] absolute, torso to the mean of the planned yaws on the ground at touchdowns.
        com_errors: (n - 1,) [m] COM at touchdowns to the middle of the planned feet.
        torque_shares: (nu,) largest torques by their limits.
        qp_failures: ticks whose whole-body QP did not converge.
        velocity_rms: [m/s] root mean square of the error of the believed COM velocity.
    """

    fallen: bool
    seconds: float
    steps: int
    planned: int
    speed: float
    planned_speed: float
    turn_rate: float
    planned_turn_rate: float
    footstep_errors: Float[np.ndarray, " n"]
    yaw_errors: Float[np.ndarray, " n"]
    heading_errors: Float[np.ndarray, " m"]
    com_errors: Float[np.ndarray, " m"]
    torque_shares: Float[np.ndarray, " nu"]
    qp_failures: int
    velocity_rms: float

    @property
    def on_the_spot(self) -> bool:
        """Whether the plan turns the feet farther than it moves the robot, so that the turn rate is what counts."""
        return _ARM * abs(self.planned_turn_rate) > self.planned_speed


def robot_rows(sample: Sample, row: int) -> Sample:
    """One robot's record of a batch's."""
    return Sample(*(np.asarray(leaf)[row] for leaf in sample))


def find_landings(sample: Sample, plan: FootstepPlan) -> Landings:
    """Touchdowns of one robot: where the step clock advances, its foot read 40 ms later."""
    count, first = int(plan.count), int(plan.first_swing)
    index, times, feet = np.full(count, -1), np.full(count, np.nan), np.full((count, 3), np.nan)
    later = max(round(_AT_REST / _spacing(sample)), 1)
    for at in np.flatnonzero(np.diff(sample.step) > 0) + 1:
        row, rest = int(sample.step[at]) - 1, at + later
        if row >= count or rest >= len(sample.step) or sample.fallen[rest]:
            continue
        foot = side_of_step(first, row)
        index[row], times[row] = at, sample.time[at]
        feet[row] = (*sample.feet[rest, foot, :2], sample.foot_yaws[rest, foot])
    return Landings(index, times, feet)


def _spacing(sample: Sample) -> float:
    """[s] between two records; the C engine's clock stands still for a robot that lies."""
    return float(np.max(np.diff(sample.time)))


def walk_metrics(
    sample: Sample, plan: FootstepPlan, torque_limits: Float[np.ndarray, " nu"], step_time: float
) -> WalkMetrics:
    """Figures of one robot.

    Args:
        sample: its record, NumPy, time first.
        plan: its own.
        torque_limits: (nu,) [N m].
        step_time: [s] nominal, of one step.
    """
    count = int(plan.count)
    positions, yaws = np.asarray(plan.positions, np.float64)[:count], np.asarray(plan.yaws, np.float64)[:count]
    landed = find_landings(sample, plan)
    made = landed.touchdown >= 0
    up = ~sample.fallen
    # Both feet of a pair must have landed for what lies between them to be known.
    pairs = np.flatnonzero(made[1:] & made[:-1]) + 1
    at = landed.touchdown[pairs]
    centre = (positions[pairs] + positions[pairs - 1]) / 2
    heading = yaws[pairs - 1] + host.wrap_angle(yaws[pairs] - yaws[pairs - 1]) / 2
    velocity_error = np.linalg.norm(sample.believed_velocity - sample.com_velocity, axis=1)[up]
    speed, planned_speed, turn_rate, planned_turn = _rates(landed, positions, yaws, step_time)
    torques = sample.torques[up] if up.any() else np.full_like(sample.torques[:1], np.nan)
    return WalkMetrics(
        fallen=bool(sample.fallen[-1]),
        seconds=float(np.sum(up)) * _spacing(sample),
        steps=int(made.sum()),
        planned=count,
        speed=speed,
        planned_speed=planned_speed,
        turn_rate=turn_rate,
        planned_turn_rate=planned_turn,
        footstep_errors=np.linalg.norm(landed.feet[made, :2] - positions[made], axis=1),
        yaw_errors=np.abs(host.wrap_angle(landed.feet[made, 2] - yaws[made])),
        heading_errors=np.abs(host.wrap_angle(np.asarray(sample.heading)[at] - heading)),
        com_errors=np.linalg.norm(sample.com[at, :2] - centre, axis=1),
        torque_shares=np.max(torques, axis=0) / torque_limits,
        qp_failures=int(np.sum(sample.qp_failures[up])),
        velocity_rms=float(np.sqrt(np.mean(velocity_error**2))) if up.any() else float("nan"),
    )


def _rates(
    landed: Landings, positions: np.ndarray, yaws: np.ndarray, step_time: float
) -> tuple[float, float, float, float]:
    """Achieved and planned speed [m/s], achieved and planned turn rate [rad/s] of the steady part."""
    nothing = (float("nan"),) * 4
    if len(positions) < 4:
        return nothing
    moves, made = _between_tracks(np.diff(positions, axis=0)), _between_tracks(np.diff(landed.feet[:, :2], axis=0))
    turns, turned = (_between_tracks(host.wrap_angle(np.diff(each))) for each in (yaws, landed.feet[:, 2]))
    times = _between_tracks(np.diff(landed.times))
    lengths = np.linalg.norm(moves, axis=1)
    pace = np.abs(turns) if _ARM * np.abs(turns).max() > lengths.max() else lengths
    steady = (pace >= _STEADY * pace.max()) & np.isfinite(made).all(axis=1)
    if not steady.any():
        return nothing
    ahead = moves[steady] / np.maximum(lengths[steady], 1e-6)[:, None]
    duration, nominal = float(np.sum(times[steady])), float(steady.sum()) * step_time
    way, planned_way = float(np.sum(made[steady] * ahead)), float(np.sum(lengths[steady]))
    turn, planned_turn = float(np.sum(turned[steady])), float(np.sum(turns[steady]))
    return way / duration, planned_way / nominal, turn / duration, planned_turn / nominal


def _between_tracks(steps: np.ndarray) -> np.ndarray:
    """Differences of successive footsteps as those of the line midway between the two tracks."""
    return (steps[:-2] + 2 * steps[1:-1] + steps[2:]) / 4


def speed_error(metrics: WalkMetrics) -> float:
    """Relative error of the speed [%], or of the turn rate where the plan only turns; NaN where it does neither."""
    achieved, planned = metrics.speed, metrics.planned_speed
    if metrics.on_the_spot:
        achieved, planned = metrics.turn_rate, metrics.planned_turn_rate
    return 100.0 * (achieved - planned) / planned if abs(planned) > 1e-3 else float("nan")


def walk_record(
    sample: Sample,
    plan: FootstepPlan,
    torque_limits: Float[np.ndarray, " nu"],
    step_time: float,
    commanded_speed: float | None = None,
    path: Float[np.ndarray, "n 2"] | None = None,
    push_times: tuple[float, ...] = (),
    friction: float | None = None,
    leg_motors: int = WalkRecord.leg_motors,
) -> WalkRecord:
    """One robot's record in the form that pictures and videos take; footsteps not made keep their planned rhythm."""
    landed = find_landings(sample, plan)
    count = int(plan.count)
    times = landed.times.copy()
    for k in np.flatnonzero(np.isnan(times)):
        times[k] = (times[k - 1] if k else float(sample.time[0])) + step_time
    sides = side_of_step(int(plan.first_swing), np.arange(count))
    planned = TimedFootsteps(times, np.asarray(plan.positions)[:count], np.asarray(plan.yaws)[:count], sides)
    w, x, y, z = sample.qpos[:, 3:7].T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x**2 + y**2))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    record = {name: np.asarray(leaf) for name, leaf in sample._asdict().items()}
    return WalkRecord(
        time=record["time"][0] + _spacing(sample) * np.arange(len(record["time"])),
        com=record["com"],
        com_velocity=record["com_velocity"],
        base_rpy=np.stack([roll, pitch, record["heading"]], axis=1),
        foot_positions=record["feet"],
        torques=record["torques"],
        torque_limits=torque_limits,
        forces=record["forces"],
        planned=planned,
        actual=landed.feet,
        commanded_speed=None if commanded_speed is None else np.full(len(record["time"]), commanded_speed),
        estimated_velocity=record["believed_velocity"],
        path=path,
        push_times=push_times,
        friction=friction,
        leg_motors=leg_motors,
    )
