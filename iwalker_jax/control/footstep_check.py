"""Footsteps at the door: what a plan may not ask for, and files that hold plans."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import Side, host, side_of_step, side_sign
from iwalker_jax.optimization import StepReach
from iwalker_jax.runtime import read_text
from iwalker_jax.runtime.reading import printable

_LARGEST_TURN = 0.6  # rad between successive feet; the hip yaws by half of it either way


def check_footsteps(
    positions: Float[np.ndarray, "k 2"],
    yaws: Float[np.ndarray, " k"],
    first_swing: int,
    reach: StepReach,
    stance: Float[np.ndarray, " 3"] | None = None,
) -> None:
    """Raise InputError for the first footstep that is out of reach, crosses the legs or turns too far.

    Args:
        positions, yaws: [m], [rad] as in `FootstepPlan`.
        first_swing: the `Side` of row 0.
        reach: bounds of a step in the frame between the two feet.
        stance: (3,) x, y [m] and yaw [rad] of the foot on which the first step is taken; it is not checked if left out.
    """
    places = np.concatenate([positions, np.asarray(yaws)[:, None]], axis=1)
    before = places[:-1] if stance is None else np.concatenate([np.asarray(stance)[None], places[:-1]])
    first = 1 if stance is None else 0
    for k, (a, b) in enumerate(zip(before, places[first:], strict=True), start=first):
        foot = Side(side_of_step(first_swing, k))
        turn = host.wrap_angle(b[2] - a[2])
        ahead, left = host.turn(-(a[2] + turn / 2), b[:2] - a[:2])
        outward = side_sign(foot) * left
        name = f"footstep {k + 1} ({foot.name.lower()} foot)"
        if abs(ahead) > reach.sagittal:
            raise InputError(
                f"{name} lies {abs(ahead):.2f} m {'ahead of' if ahead > 0 else 'behind'} the stance foot, "
                f"out of reach; keep steps within {reach.sagittal:.2f} m."
            )
        if outward < reach.lateral_min:
            raise InputError(
                f"{name} lies {outward:.3f} m to its own side of the stance foot and would cross the legs; "
                f"keep at least {reach.lateral_min:.3f} m, and check that left and right alternate."
            )
        if outward > reach.lateral_max:
            raise InputError(
                f"{name} lies {outward:.2f} m beside the stance foot, out of reach; "
                f"keep within {reach.lateral_max:.2f} m."
            )
        if abs(turn) > _LARGEST_TURN:
            raise InputError(
                f"{name} turns {np.degrees(turn):.0f} degrees against the stance foot; "
                f"keep within {np.degrees(_LARGEST_TURN):.0f}."
            )


def load_footsteps(file: Path) -> tuple[np.ndarray, np.ndarray, Side]:
    """Positions (K, 2) [m], yaws (K,) [rad] and the first foot of a CSV file.

    One footstep a line: `side, x, y, yaw_degrees`, side `left` or `right` in turn; lines beginning with # are comments.

    Raises:
        InputError: with the line that is wrong.
    """
    name = printable(file, 300)
    try:
        text = read_text(Path(file))
    except InputError as error:
        raise InputError(f"The footstep file {name} cannot be read: it {error}") from None
    rows: list[tuple[Side, float, float, float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        rows.append(_parse(name, number, line))
        if len(rows) > 1 and rows[-1][0] == rows[-2][0]:
            raise InputError(
                f"{name}, line {number}: the {rows[-1][0].name.lower()} foot steps twice; alternate the sides."
            )
    if len(rows) < 2:
        raise InputError(f"{name} holds {len(rows)} footsteps; give at least two, so that the walk can end standing.")
    table = np.asarray([row[1:] for row in rows])
    return table[:, :2], np.radians(table[:, 2]), rows[0][0]


def _parse(name: str, number: int, line: str) -> tuple[Side, float, float, float]:
    shown = printable(line.strip())
    parts = [part.strip() for part in line.split(",")]
    sides = {"right": Side.RIGHT, "r": Side.RIGHT, "left": Side.LEFT, "l": Side.LEFT}
    if len(parts) != 4 or parts[0].lower() not in sides:
        raise InputError(f"{name}, line {number} reads {shown!r}; write `left, x, y, yaw_degrees` in metres.")
    try:
        x, y, yaw = (float(part) for part in parts[1:])
    except ValueError as error:
        raise InputError(f"{name}, line {number}: {shown!r} holds no number where one is due.") from error
    if not np.isfinite([x, y, yaw]).all():
        raise InputError(f"{name}, line {number} holds NaN or infinity; give finite metres and degrees.")
    return sides[parts[0].lower()], x, y, yaw
