"""The camera's mount: fitted to the floor that the frames show, compared with what is written down, and explained.

A camera in other units, upside down or on its side shows no floor where one must be, so that the right change can be
found by trying.
"""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, UInt16

from iwalker_jax.data.recordings.report import FileProblem
from iwalker_jax.errors import InputError
from iwalker_jax.perception import CameraMount, FloorFit, Intrinsics, clean_depth, fit_floor, resize_depth

MAX_DEVIATION = (0.15, math.radians(10.0), math.radians(10.0))
"""[m], [rad], [rad] of one frame's fitted height, pitch and roll from the median."""

_MAX_ERROR = (0.1, math.radians(8.0), math.radians(8.0))  # of what is written down, from the fitted median
_USUAL_HEIGHT = (0.4, 0.8)  # [m] of a camera on a robot of this size
_USUAL_PITCH, _USUAL_ROLL = (math.radians(-10.0), math.radians(50.0)), math.radians(15.0)
_MIN_SHARE = 0.05  # of frames that must show the floor
_FEW = 0.5  # of frames; where fewer show the floor, another reading may show it in more
_ENOUGH = 0.6  # of the frames tried, for another reading to be named
_TRIED = 6  # frames
_SCALES = (0.001, 0.0002, 0.00025, 0.0001, 0.0005, 0.00390625, 0.005, 0.01)  # [m] per unit, of common sensors

Images = Callable[[int], UInt16[np.ndarray, "height width"]]


@dataclass(frozen=True)
class Reading:
    """One way to read the stored images.

    Attributes:
        intrinsics: of the images as stored.
        depth_scale: [m] per unit.
        quarter_turns: by which images are turned anticlockwise.
        swapped: whether the two bytes of each pixel are swapped.
    """

    intrinsics: Intrinsics
    depth_scale: float
    quarter_turns: int = 0
    swapped: bool = False


def turned(image: np.ndarray, intrinsics: Intrinsics, quarter_turns: int) -> tuple[np.ndarray, Intrinsics]:
    """An image and its intrinsics after anticlockwise quarter turns."""
    for _ in range(quarter_turns % 4):
        K = intrinsics
        intrinsics = Intrinsics(K.height, K.width, K.fy, K.fx, K.cy, K.width - 1 - K.cx)
    return np.rot90(image, quarter_turns), intrinsics


def fit_mount(frame: Float[Array, "height width"], camera: Intrinsics) -> Float[np.ndarray, " 4"]:
    """[height m, pitch rad, roll rad, valid] of one frame."""
    fit = _fit(frame, camera)
    return np.array([fit.height, fit.pitch, fit.roll, fit.valid], float)


@functools.partial(jax.jit, static_argnums=1)
def _fit(frame: Float[Array, "height width"], camera: Intrinsics) -> FloorFit:
    return fit_floor(clean_depth(frame), camera)


def check_mount(
    written: Float[np.ndarray, "n 3"] | None,
    where: str,
    fits: Float[np.ndarray, "n 4"],
    images: Images,
    reading: Reading,
    camera: Intrinsics,
) -> list[FileProblem]:
    """Doubts about the camera's mount, units and intrinsics that the floor raises.

    Args:
        written: [height, pitch, roll] that are written down for each frame, NaN where they are not; None if nothing is.
        where: they are written.
        fits: `fit_mount` of each frame.
        images: stored image of a row.
        reading: how they were read.
        camera: that frames are re-projected to.

    Raises:
        InputError: if hardly any frame shows the floor, or what is written down is not what the floor shows; if
            another reading of the images explains it, it is named.
    """
    valid, n = fits[:, 3] > 0, len(fits)
    expected = np.full(3, np.nan) if written is None else _median(written)
    errors = np.zeros(3) if written is None else _errors(written, fits)
    found = f"the floor was found in {int(valid.sum())} of {n} frames"
    seen = bool(valid.sum() >= max(1.0, _MIN_SHARE * n))
    disagrees = seen and bool((errors > _MAX_ERROR).any())
    doubtful = seen and math.isnan(expected[0]) and not _is_usual(_median(fits[valid, :3]), expected)
    if seen and not disagrees and not doubtful and valid.mean() >= _FEW:
        return []
    better = _better_reading(expected, valid, images, reading, camera, prefer_more=not (disagrees or doubtful))
    if not seen:
        raise InputError(
            f"{found[0].upper()}{found[1:]}, so none shows free ground ahead; "
            + (better or "check the depth scale, the intrinsics and how the camera is mounted.")
        )
    if disagrees:
        raise InputError(
            f"{where} says {_words(expected)}, but {found} and it lies as from {_words(_median(fits[valid, :3]))}; "
            + (better or "correct what is written, the depth scale or the intrinsics.")
        )
    if doubtful:
        return [
            FileProblem(
                "mount",
                f"is unusual for this robot: {found}, as from {_words(_median(fits[valid, :3]))}; "
                + (better or "check the depth scale and the intrinsics, or write the mount down if it is right."),
            )
        ]
    if better:
        raise InputError(f"{found[0].upper()}{found[1:]}; {better}")
    return [FileProblem("floor", f"is not seen in every frame: {found}.")] if written is None else []


def _median(values: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " 3"]:
    """Column medians of what is known; NaN where nothing is."""
    columns = [column[np.isfinite(column)] for column in values.T]
    return np.array([np.median(column) if column.size else math.nan for column in columns])


def _errors(written: Float[np.ndarray, "n 3"], fits: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, " 3"]:
    """Median difference of what is written for a frame from its floor; 0 where nothing is written."""
    return np.nan_to_num(np.abs(_median((written - fits[:, :3])[fits[:, 3] > 0])))


def _is_usual(fit: Float[np.ndarray, " 3"], expected: Float[np.ndarray, " 3"]) -> bool:
    """Whether what is not written down is as on a robot of this size."""
    height, pitch, roll = fit
    return bool(
        (_USUAL_HEIGHT[0] <= height <= _USUAL_HEIGHT[1] or not math.isnan(expected[0]))
        and (_USUAL_PITCH[0] <= pitch <= _USUAL_PITCH[1] or not math.isnan(expected[1]))
        and (abs(roll) <= _USUAL_ROLL or not math.isnan(expected[2]))
    )


def _words(mount: Float[np.ndarray, " 3"]) -> str:
    height, pitch, roll = mount
    parts = [
        "" if math.isnan(height) else f"a height of {height:.2f} m",
        "" if math.isnan(pitch) else f"a pitch of {math.degrees(pitch):.0f} degrees down",
        "" if math.isnan(roll) else f"a roll of {math.degrees(roll):.0f} degrees",
    ]
    return ", ".join(part for part in parts if part)


def _better_reading(
    expected: Float[np.ndarray, " 3"],
    valid: Bool[np.ndarray, " n"],
    images: Images,
    reading: Reading,
    camera: Intrinsics,
    prefer_more: bool,
) -> str | None:
    """The sentence of the likeliest other reading under which most frames show the floor as expected, if any."""
    rows = np.unique(np.linspace(0, len(valid) - 1, min(_TRIED, len(valid))).astype(int))
    if prefer_more and valid[rows].mean() > 0.5 * _ENOUGH:
        return None
    stored = [images(int(row)) for row in rows]
    height = CameraMount.height if math.isnan(expected[0]) else expected[0]
    for likely in _readings(reading):
        found = []
        for other in likely:
            fits = np.array([fit_mount(_frame(image, other, camera), camera) for image in stored])
            good = np.array([fit[3] > 0 and _agrees(fit[:3], expected) for fit in fits])
            if np.mean(good) >= _ENOUGH:
                away = abs(math.log(np.median(fits[good, 0]) / height))
                found.append(
                    (away, f"{_change(reading, other)} ({sum(good)} of {len(good)} frames tried show it then).")
                )
        if found:
            return min(found)[1]
    return None


def _agrees(fit: Float[np.ndarray, " 3"], expected: Float[np.ndarray, " 3"]) -> bool:
    """Whether a fit is what is written down, and usual where nothing is."""
    return _is_usual(fit, expected) and bool((np.nan_to_num(np.abs(fit - expected)) <= _MAX_ERROR).all())


def _readings(reading: Reading) -> Iterator[list[Reading]]:
    """Groups of other readings, the likeliest first: another scale, turned, swapped bytes, turned at another scale."""
    scales = [scale for scale in _SCALES if not math.isclose(scale, reading.depth_scale, rel_tol=0.05)]
    yield [replace(reading, depth_scale=scale) for scale in scales]
    turns = [(reading.quarter_turns + turn) % 4 for turn in (2, 1, 3)]
    yield [replace(reading, quarter_turns=turn) for turn in turns]
    yield [replace(reading, swapped=True)]
    yield [replace(reading, quarter_turns=turn, depth_scale=scale) for turn in turns for scale in scales]


def _change(reading: Reading, other: Reading) -> str:
    changes = []
    turn = (other.quarter_turns - reading.quarter_turns) % 4
    if turn == 2:
        changes.append("the camera seems to be upside down: turn the images and the principal point by 180 degrees")
    elif turn:
        way = "anticlockwise" if turn == 1 else "clockwise"
        changes.append(f"the camera seems to lie on its side: turn images and intrinsics by 90 degrees {way}")
    if other.depth_scale != reading.depth_scale:
        changes.append(f"the depth scale seems to be {other.depth_scale:g} m per unit, not {reading.depth_scale:g}")
    if other.swapped:
        changes.append("the two bytes of each pixel seem to be swapped: write the images as big-endian PNG")
    return " and ".join(changes)


def _frame(image: UInt16[np.ndarray, "_ _"], reading: Reading, camera: Intrinsics) -> Float[Array, "height width"]:
    units = image.byteswap() if reading.swapped else image
    depth = units.astype(np.float32) * np.float32(reading.depth_scale)
    depth, intrinsics = turned(depth, reading.intrinsics, reading.quarter_turns)
    return resize_depth(jnp.asarray(depth), intrinsics, camera)


def mounts_of(
    recorded: Float[np.ndarray, "n 5"] | None, fits: Float[np.ndarray, "n 4"]
) -> tuple[Float[np.ndarray, "n 5"], tuple[str, ...]]:
    """(mounts, assumptions): recorded ones, their height fitted where it is NaN; all fitted where none are recorded."""
    if recorded is not None and np.isfinite(recorded).all():
        return recorded, ()
    valid = fits[:, 3] > 0
    median = np.median(fits[valid, :3], axis=0)
    origin = f"fitted (the floor was found in {int(valid.sum())} of {len(fits)} frames)"
    if recorded is not None:
        mounts = np.where(np.isfinite(recorded), recorded, 0.0)
        mounts[:, 0] = median[0]
        return mounts, (f"The camera's height, {median[0]:.2f} m, is {origin}.",)
    near = valid & (np.abs(fits[:, :3] - median) <= MAX_DEVIATION).all(axis=1)
    tilt = np.where(near[:, None], fits[:, :3], median)
    mounts = np.concatenate([tilt, np.zeros((len(fits), 2))], axis=1)
    degrees = np.degrees(median[1:])
    return mounts, (
        f"The camera's mount is {origin}: median height {median[0]:.2f} m, pitch {degrees[0]:.1f} degrees down, roll "
        f"{degrees[1]:.1f} degrees; it is taken to sit above the base's origin.",
    )
