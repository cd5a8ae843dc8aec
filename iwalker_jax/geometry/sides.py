"""The two feet: how they are numbered, which way each lies, and how they take turns.

Whatever is stored for both feet is ordered right, left. The functions take whole numbers, NumPy and JAX arrays alike
and return the same kind.
"""

from enum import IntEnum
from typing import Any

import numpy as np


class Side(IntEnum):
    """A foot, or a footstep by the foot that makes it."""

    RIGHT = 0
    LEFT = 1


def other_side(side: Any) -> Any:
    """The other foot."""
    return 1 - side


def side_sign(side: Any) -> Any:
    """+1 for the left and -1 for the right foot: the direction in which it lies along the y axis, which points left."""
    return 2 * side - 1


def side_of_step(first: Any, step: Any) -> Any:
    """The foot that makes a footstep of an alternating sequence.

    Args:
        first: the foot that makes footstep 0.
        step: the footstep's number, from 0; of an array, each one's.
    """
    return (first + step) % 2


def footstep_signs(stance_sign: Any, count: int) -> Any:
    """Signs of the next footsteps, the first by the foot that does not stand.

    Args:
        stance_sign: (*batch,) `side_sign` of the stance foot.
        count: footsteps.

    Returns:
        (*batch, count), see `side_sign`.
    """
    return stance_sign[..., None] * side_sign(side_of_step(Side.RIGHT, np.arange(count)))
