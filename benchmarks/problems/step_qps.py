"""The step MPC as a plain QP, for general solvers: physical states kept as variables, nothing eliminated."""

from typing import NamedTuple

import numpy as np

from iwalker_jax.optimization import HlipParameters, StepMpcWeights


class StepQp(NamedTuple):
    """min z'H z / 2 + g'z + constant with E z = e and low <= G z <= high; z holds [c, p, v, u] a step and plane.

    Attributes:
        hessian, linear, constant: H (n, n), g (n,), and the constant that makes the minimum the MPC's cost.
        dynamics, drift: E (6 N, n), e (6 N,).
        heading: G (2 N, n), step sizes turned into each step's heading frame (sagittal, lateral).
    """

    hessian: np.ndarray
    linear: np.ndarray
    constant: float
    dynamics: np.ndarray
    drift: np.ndarray
    heading: np.ndarray

    def unpack(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Footsteps (N, 2), states (N, 2, 3) and inputs (N, 2) of a solution."""
        z = z.reshape(-1, 2, 4)
        return z[:, :, 0] - z[:, :, 1], z[:, :, :3], z[:, :, 3]

    def cost(self, z: np.ndarray) -> float:
        """Objective at z."""
        return float(z @ self.hessian @ z / 2 + self.linear @ z + self.constant)


def irregular_walk(
    horizon: int, seed: int = 0, noise: float = 0.02, kick: float = 0.02, turn: float = 0.1, speed: float = 0.08
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Footsteps (N, 2) along an arc, right foot first, a state (2, 3) on the left foot, and headings (N,).

    Args:
        noise: standard deviation of the footsteps [m].
        kick: standard deviation of the state about a regular gait's [m, m, m/s].
        turn: heading change [rad] a step.
        speed: mean step [m].
    """
    rng = np.random.default_rng(seed)
    headings = turn * np.arange(1, horizon + 1)
    centre = np.cumsum(speed * np.stack([np.cos(headings), np.sin(headings)], 1), axis=0)
    side = np.where(np.arange(horizon) % 2 == 0, -0.045, 0.045)[:, None]
    left = np.stack([-np.sin(headings), np.cos(headings)], 1)
    footsteps = centre + side * left + rng.normal(0, noise, (horizon, 2))
    state = np.array([[0.04, 0.04, 0.35], [0.01, -0.035, -0.15]]) + rng.normal(0, kick, (2, 3))
    return footsteps, state, headings


def step_map(parameters: HlipParameters) -> tuple[np.ndarray, np.ndarray]:
    """A and B of eq. 9 by NumPy alone."""
    rate = np.sqrt(parameters.gravity / parameters.com_height)
    single, double = parameters.single_support_time, parameters.double_support_time
    cosh, sinh = np.cosh(rate * single), np.sinh(rate * single)
    drift = double * cosh + sinh / rate
    state = np.array([[1, cosh - 1, drift], [0, cosh, drift], [0, rate * sinh, cosh + rate * double * sinh]])
    return state, np.array([1 - cosh, -cosh, -rate * sinh])


def orbit(parameters: HlipParameters, step: float, after: float) -> np.ndarray:
    """(p, v) of the period-two orbit, as the fixed point of two steps of the map (no closed form used)."""
    full, column = step_map(parameters)
    state, column = full[1:, 1:], column[1:]
    return np.linalg.solve(np.eye(2) - state @ state, state @ column * step + column * after)


def build_step_qp(
    footsteps: np.ndarray,
    initial_state: np.ndarray,
    parameters: HlipParameters,
    weights: StepMpcWeights,
    headings: np.ndarray | None = None,
) -> StepQp:
    """Assemble the QP of `solve_step_mpc` and of its bounded variant for N >= 2 wanted footsteps."""
    horizon = len(footsteps)
    size = 8 * horizon
    hessian, linear, constant = np.zeros((size, size)), np.zeros(size), 0.0
    dynamics, drift = np.zeros((6 * horizon, size)), np.zeros(6 * horizon)
    state, column = step_map(parameters)
    values, vectors = np.linalg.eig(state[1:, 1:].T)
    divergent = vectors[:, np.argmax(values)] / vectors[0, np.argmax(values)]
    for plane in range(2):
        stance = initial_state[plane, 0] - initial_state[plane, 1]
        steps = np.diff(np.concatenate([[stance], footsteps[:, plane]]))
        steps = np.concatenate([steps, steps[-2:]])
        for k in range(horizon):
            at = 8 * k + 4 * plane
            gait = orbit(parameters, steps[k + 1], steps[k + 2])
            terms: list[tuple[list, float, float]] = [
                ([1, -1, 0, 0], footsteps[k, plane], weights.footstep),
                ([0, 1, 0, 0], gait[0], weights.orbit_position),
                ([0, 0, 1, 0], gait[1], weights.orbit_velocity),
                ([0, 0, 0, 1], 0.0, weights.effort),
            ]
            if k == horizon - 1:
                terms.append(([0, *divergent, 0], divergent @ gait, weights.terminal))
            for selector, target, weight in terms:
                row = np.asarray(selector, float)
                hessian[at : at + 4, at : at + 4] += 2 * weight * np.outer(row, row)
                linear[at : at + 4] -= 2 * weight * target * row
                constant += weight * target**2
            rows = slice(6 * k + 3 * plane, 6 * k + 3 * plane + 3)
            dynamics[rows, at : at + 3] = np.eye(3)
            dynamics[rows, at + 3] = -column
            if k == 0:
                drift[rows] = state @ initial_state[plane]
            else:
                dynamics[rows, at - 8 : at - 5] = -state
    heading = np.zeros((2 * horizon, size))
    for k, angle in enumerate(np.zeros(horizon) if headings is None else headings):
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        heading[2 * k : 2 * k + 2, [8 * k + 3, 8 * k + 7]] = turn
    return StepQp(hessian, linear, constant, dynamics, drift, heading)
