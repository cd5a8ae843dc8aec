"""Random references for the unicycle MPC."""

import numpy as np

POINTS = 100


def references(count: int, seed: int = 0) -> np.ndarray:
    """Random references, smooth (splines, arcs up to two turns, wandering) and jagged (polylines, zigzags, noise)."""
    rng = np.random.default_rng(seed)
    made = []
    for k in range(count):
        size, points = rng.uniform(1, 10), np.linspace(0, 1, POINTS)
        match k % 7:
            case 0:
                knots = (
                    np.concatenate([[[0, 0]], np.cumsum(rng.normal(size=(5, 2)) + np.array([1, 0]), axis=0)]) * size / 5
                )
                coefficients = np.polyfit(np.linspace(0, 1, 6), knots, 5)
                path = np.stack([np.polyval(c, points) for c in coefficients.T], axis=1)
            case 1 | 2:
                bend = np.convolve(np.cumsum(rng.normal(size=POINTS) * 0.15), np.ones(9) / 9, "same")
                angle = rng.uniform(-3, 3) + (rng.uniform(-4, 4) * np.pi * points if k % 7 == 1 else bend)
                path = np.cumsum(np.stack([np.cos(angle), np.sin(angle)], axis=1), axis=0) * size / POINTS
            case 3:
                corners = np.concatenate([[[0, 0]], rng.uniform(-1, 1, (rng.integers(2, 8), 2)) * size])
                along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
                path = np.stack([np.interp(points * along[-1], along, c) for c in corners.T], axis=1)
            case 4:
                path = np.cumsum(rng.normal(size=(POINTS, 2)), axis=0) * size / 20
            case 5:
                wave = 2 * np.abs(2 * ((points * size * rng.uniform(0.3, 2)) % 1) - 1) - 1
                path = np.stack([points * size, wave * size / 10], axis=1)
            case _:
                path = np.stack([points * size, 0 * points], axis=1) + rng.normal(size=(POINTS, 2)) * 0.1
        made.append(path - path[0])
    return np.array(made, np.float32)
