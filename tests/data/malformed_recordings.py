"""A generator of malformed recordings whose oracle knows what was broken: python -m tests.data.malformed_recordings.

Each case is one good recording with one thing wrong, and what must come of it:
`refused` (unusable, with a sentence), `left_out` (the named images only), `doubted` (refused, or a problem is named),
`same` (as usable as without the change), or `as_written` (refused, or read as an independent parser reads it).
"""

import argparse
import codecs
import os
import socket
import struct
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from iwalker_jax.data import frames_from_recording, validate_recording
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics
from tests.data.recording_folders import CAMERA_HEIGHT, FOCAL, HEIGHT, INTRINSICS, PITCH, ROLL, WIDTH, floor_image

SECONDS = 10.0
"""[s] of a processor; a case that takes longer hangs."""

FRAMES = 5
POSES = [[0.4 * k, 0.1 * k, 0.25] for k in range(FRAMES)]
MOUNT = {"height": CAMERA_HEIGHT, "pitch_deg": float(np.degrees(PITCH)), "roll_deg": float(np.degrees(ROLL))}
BODY_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def png(image: np.ndarray) -> bytes:
    """An image as OpenCV encodes it."""
    return cv2.imencode(".png", np.ascontiguousarray(image))[1].tobytes()


FLOORS = [floor_image(1000.0, 0.01 * k) for k in range(FRAMES)]
GOOD_IMAGES = [png(image) for image in FLOORS]


@dataclass
class Draft:
    """A recording to be written: text and image files by name, special files by what makes them.

    Attributes:
        content: of recording.yaml; None writes none.
        files: bytes by name, besides.
        special: makes a file that is none, by name.
        expected: what must come of it (see the module).
        left: images that must be left out.
        given: whether intrinsics are given by the caller.
        poses: x [m] of each usable frame, if they must be known.
    """

    content: dict[str, Any] | None = None
    files: dict[str, bytes] = field(default_factory=dict)
    special: dict[str, Callable[[Path], Any]] = field(default_factory=dict)
    expected: str = "refused"
    left: tuple[str, ...] = ()
    given: bool = False
    poses: list[float] | None = None

    def write(self, folder: Path) -> Path:
        folder.mkdir()
        if self.content is not None:
            (folder / "recording.yaml").write_text(yaml.safe_dump(self.content))
        for name, content in self.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        for name, make in self.special.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).unlink(missing_ok=True)
            make(folder / name)
        return folder

    def yaml(self, text: str | bytes) -> None:
        """recording.yaml of this very text."""
        self.content = None
        self.files["recording.yaml"] = text if isinstance(text, bytes) else text.encode()


def image_name(k: int) -> str:
    return f"depth/{k:06d}.png"


def yaml_draft(rng: np.random.Generator, mount: bool | None = None, poses: bool | None = None) -> Draft:
    """A good recording in the yaml layout, with or without mount and poses."""
    content: dict[str, Any] = {"intrinsics": dict(INTRINSICS), "depth_scale": 0.001}
    if rng.random() < 0.5 if mount is None else mount:
        content["mount"] = dict(MOUNT)
    if rng.random() < 0.5 if poses is None else poses:
        content["poses"] = [list(row) for row in POSES]
    return Draft(content, {image_name(k): GOOD_IMAGES[k] for k in range(FRAMES)})


def optical_quaternion() -> list[float]:
    level = Rotation.from_euler("y", PITCH).as_matrix() @ BODY_FROM_OPTICAL
    return Rotation.from_matrix(level @ Rotation.from_euler("z", ROLL).as_matrix()).as_quat().tolist()


def tum_draft() -> Draft:
    stamps = [100 + 0.1 * k for k in range(FRAMES)]
    q = " ".join(f"{x:.6f}" for x in optical_quaternion())
    files = {f"depth/{s:.6f}.png": png(floor_image(5000.0, 0.01 * k)) for k, s in enumerate(stamps)}
    files["depth.txt"] = "".join(f"{s:.6f} depth/{s:.6f}.png\n" for s in stamps).encode()
    files["groundtruth.txt"] = "".join(f"{s:.4f} {0.3 * k} 0 0.6 {q}\n" for k, s in enumerate(stamps)).encode()
    return Draft(None, files, given=True)


def iplanner_draft() -> Draft:
    files = {f"depth/{k}.png": GOOD_IMAGES[k] for k in range(FRAMES)}
    files["depth_intrinsic.txt"] = str([FOCAL, 0.0, 59.5, 0.0, 0.0, FOCAL, 44.5, 0.0, 0.0, 0.0, 1.0, 0.0]).encode()
    files["camera_extrinsic.txt"] = str([0.1, 0.0, 0.2, *optical_quaternion()]).encode()
    files["odom_ground_truth.txt"] = "".join(f"[{0.3 * k}, 0, 0.4, 0, 0, 0, 1]\n" for k in range(FRAMES)).encode()
    return Draft(None, files)


# ---------------------------------------------------------------- recording.yaml


ODD_VALUES = (
    "9" * 400, "-" + "9" * 5000, "1e999", ".nan", "-.inf", "-1", "0", "true", "null", "", "sixty", "[1]", "{a: 1}",
    "1:30", "0x1F", "'120'", '"1\\0"', "!!int 5", "1_20", "120 px", "1e-400", "2023-01-01", "&a 5",
)  # fmt: skip


def odd_value(rng):
    draft = yaml_draft(rng, mount=True)
    group = rng.choice(["intrinsics", "mount", ""])
    key = rng.choice(list(draft.content[group] if group else ["depth_scale"]))
    (draft.content[group] if group else draft.content)[key] = "PUT-IT-HERE"
    value = str(rng.choice(ODD_VALUES))
    draft.yaml(yaml.safe_dump(draft.content).replace("PUT-IT-HERE", value))
    if key in ("cx", "cy", "roll_deg", "pitch_deg") and value in ("0", "-1", "1e-400"):
        draft.expected = "as_written"  # a roll or pitch near 0 may be within what is doubted
    return draft


def damaged_text(rng):
    """Bytes of the YAML removed, doubled, replaced or put in; the oracle is PyYAML."""
    draft = yaml_draft(rng)
    text = bytearray(yaml.safe_dump(draft.content).encode())
    for _ in range(rng.integers(1, 4)):
        at, span = rng.integers(len(text)), rng.integers(1, 6)
        new = rng.choice(
            [b"", bytes(text[at : at + span]) * 2, rng.bytes(int(span)), b"\0", b"\t", b"{", b"]", b": ", b"- "]
        )
        text[at : at + (span if rng.random() < 0.6 else 0)] = bytes(new)
    draft.yaml(bytes(text))
    draft.expected = "as_written"
    return draft


def hostile_yaml(rng):
    draft = yaml_draft(rng, poses=False)
    text = yaml.safe_dump(draft.content)
    depth = int(rng.integers(20, 200_000))
    bomb = "a0: &a0 [x]\n" + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12))
    draft.yaml(
        [
            text + "poses: " + "[" * depth + "]" * depth,
            text + "poses: " + "[" * depth,
            text + "poses: " + "{a: " * min(depth, 20_000) + "1" + "}" * min(depth, 20_000),
            text + "".join("  " * k + "- \n" for k in range(60)),
            bomb + text,
            text + "poses: &p [*p]\n",
            text + "depth_scale: 0.01\n",
            text + "---\n" + text,
            text + "poses: !!python/object/apply:os.system [echo]\n",
            text + "posse: []\n",
            text + "poses: null\n",
            text + "poses: []\n",
            text + "? [a, b]\n: 1\n",
            "",
            "[]",
            "42",
            "# nothing\n",
            text + "#" * 3_000_000,
            text + "poses: [" + "[0, 0, 0], " * 300_000 + "]\n",
            text.encode("utf-16") + b"\xd8\x00",
            text.encode() + b"# caf\xe9\n",
            text + "# \0\n",
            text.replace("fx", "Fx"),
            text.replace("height: 90", "heigth: 90"),
            text + "\x1b[2Jposes: 1\n",
        ][rng.integers(25)]
    )
    return draft


def readable_yaml(rng):
    """What other programs write, and people: it must be read as it is meant."""
    draft = yaml_draft(rng)
    text = yaml.safe_dump(draft.content, default_flow_style=[None, False, True][rng.integers(3)])
    text = text.replace("0.001", str(rng.choice(["1e-3", "1E-3", "1.0e-03", ".001", "0.001"])))
    text = [text, text.replace("\n", "\r\n"), "---\n" + text + "...\n", "# a comment\n" + text, text + "\n\n"][
        rng.integers(5)
    ]
    encoded = [text.encode(), codecs.BOM_UTF8 + text.encode(), text.encode("utf-16")][rng.integers(3)]
    draft.yaml(encoded)
    draft.expected = "same"
    return draft


def path_that_leaves(rng):
    draft = yaml_draft(rng, poses=False)
    draft.files["other/poses.txt"] = b"0 0 0\n"
    key = str(rng.choice(["poses", "goals", "depth"]))
    bad: list[Any] = [
        "/etc/passwd",
        "../secret.txt",
        "a/../../secret.txt",
        "",
        " ",
        "a\0b",
        "x" * 2000,
        5,
        True,
        "/",
        "..",
    ]
    if key != "depth":
        bad += [".", "other", "absent.txt", "pipe.txt", "link.txt", "loop.txt", "poses.txt\n", "~"]
        draft.special = {
            "pipe.txt": os.mkfifo,
            "link.txt": lambda path: path.symlink_to("/etc/passwd"),
            "loop.txt": lambda path: path.symlink_to("loop.txt"),
        }
    draft.content[key] = bad[rng.integers(len(bad))]
    return draft


# ---------------------------------------------------------------- mount, units, orientation, intrinsics


def wrong_mount(rng):
    draft = yaml_draft(rng, mount=True)
    key, value = [
        ("height", 0.6 * rng.uniform(1.3, 3.0)),
        ("height", 0.6 * rng.uniform(0.1, 0.75)),
        ("height", 60.0),
        ("height", 600.0),
        ("height", -0.6),
        ("pitch_deg", float(PITCH)),
        ("pitch_deg", -20.0),
        ("pitch_deg", 20.0 + rng.choice([-1, 1]) * rng.uniform(10, 60)),
        ("roll_deg", 6.0 + rng.choice([-1, 1]) * rng.uniform(10, 50)),
        ("roll_deg", 180.0),
        ("forward", 30.0),
        ("left", -400.0),
    ][rng.integers(12)]
    draft.content["mount"][key] = float(value)
    return draft


def wrong_scale(rng):
    draft = yaml_draft(rng)
    factor = float(rng.choice([0.001, 0.1, 0.2, 0.25, 0.5, 2, 3, 4, 5, 10, 100, 1000, 1e6]))
    draft.content["depth_scale"] = 0.001 * factor
    draft.expected = "refused" if "mount" in draft.content else "doubted"
    if rng.random() < 0.3 and factor in (0.2, 0.25, 4, 5, 10):  # the images instead of the number
        del draft.content["depth_scale"]
        units = [np.minimum(image * factor, 65535).astype(np.uint16) for image in FLOORS]
        draft.files |= {image_name(k): png(unit) for k, unit in enumerate(units)}
    return draft


def turned_images(rng):
    draft = yaml_draft(rng)
    turn = int(rng.integers(1, 4))
    how = rng.integers(3)
    change = [
        lambda image: np.rot90(image, turn),
        lambda image: image[::-1],
        lambda image: image.byteswap(),
    ][how]
    draft.files |= {image_name(k): png(change(image)) for k, image in enumerate(FLOORS)}
    if how == 0 and turn != 2:
        draft.content["intrinsics"] = {"width": HEIGHT, "height": WIDTH, "fx": 60.0, "fy": 60.0, "cx": 44.5, "cy": 59.5}
    draft.expected = "refused" if "mount" in draft.content else "doubted"
    return draft


def wrong_intrinsics(rng):
    draft = yaml_draft(rng, mount=True)
    K = draft.content["intrinsics"]
    factor = float(rng.choice([0.25, 0.5, 2 / 3, 1.5, 2.0, 4.0]))
    how = rng.integers(6)
    if how == 0:  # of another resolution, with this one's size
        K |= {key: K[key] * factor for key in ("fx", "fy", "cx", "cy")}
    elif how == 1:  # of another resolution
        K |= {key: K[key] * factor for key in K} | {key: int(K[key] * factor) for key in ("width", "height")}
    elif how == 2:
        K |= {"fx": K["fx"] * factor, "fy": K["fy"] * factor}
    elif how == 3:
        K |= {"width": K["height"], "height": K["width"]}
    elif how == 4:
        K |= {"width": int(10 ** rng.uniform(4, 18)), "height": 90}
    else:
        K |= {"cx": K["cy"], "cy": K["cx"]}
    return draft


# ---------------------------------------------------------------- images


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def raw_png(width=WIDTH, height=HEIGHT, bits=16, colour=0, interlace=0, pixels=b"", extra=b"") -> bytes:
    """A PNG made by hand, every checksum right."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, interlace))
    return b"\x89PNG\r\n\x1a\n" + header + extra + chunk(b"IDAT", zlib.compress(pixels, 1)) + chunk(b"IEND", b"")


def rows_of(image: np.ndarray, filter_type: int = 0) -> bytes:
    return b"".join(bytes([filter_type]) + row.astype(">u2").tobytes() for row in image)


def damaged_image(rng):
    draft = yaml_draft(rng)
    k = int(rng.integers(FRAMES))
    good, whole = GOOD_IMAGES[k], rows_of(FLOORS[k])
    flipped = bytearray(good)
    flipped[rng.integers(len(good))] ^= 1 << int(rng.integers(8))
    cut = int(rng.integers(1, len(good)))
    bad = [
        bytes(flipped),
        bytes(flipped),
        good[:-cut],
        good[cut:],
        good[: cut // 2] + good[cut:],
        b"",
        rng.bytes(500),
        b"\xff\xd8\xff" + rng.bytes(500),
        b"\x89PNG\r\n\x1a\n" + rng.bytes(300),
        raw_png(40_000, 40_000, pixels=whole),
        raw_png(2**31 - 1, 2**31 - 1),
        raw_png(0, 0),
        raw_png(pixels=whole[: len(whole) // 2]),
        raw_png(pixels=whole + bytes(60_000_000)),
        raw_png(pixels=rows_of(FLOORS[k], 9)),
        raw_png(pixels=whole, interlace=1),
        raw_png(pixels=whole, bits=8),
        raw_png(pixels=whole, bits=12),
        raw_png(pixels=whole, colour=2),
        raw_png(pixels=whole, colour=6),
        raw_png(pixels=whole, colour=77),
        raw_png(pixels=whole, extra=chunk(b"tRNS", b"\x05\xdc")),
        raw_png(pixels=whole, extra=chunk(b"acTL", struct.pack(">II", 3, 0))),
        raw_png(pixels=whole, extra=chunk(b"IHDR", bytes(13))),
        png((FLOORS[k] // 20).astype(np.uint8)),
        png(np.repeat(FLOORS[k][..., None], 3, axis=2)),
        png(FLOORS[k][: HEIGHT - int(rng.integers(1, 60))]),
        png(np.zeros_like(FLOORS[k])),
        png(np.full_like(FLOORS[k], rng.integers(1, 65535))),
        png(np.maximum(FLOORS[k], 1500) * 8),
    ][rng.integers(30)]
    draft.files[image_name(k)] = bad
    draft.expected, draft.left = "left_out", (image_name(k),)
    return draft


def image_that_is_no_file(rng):
    draft = yaml_draft(rng)
    k = int(rng.integers(FRAMES))

    def make_socket(path: Path) -> None:
        place = os.getcwd()
        os.chdir(path.parent)  # a socket's whole path may have 107 characters only
        try:
            with socket.socket(socket.AF_UNIX) as listener:
                listener.bind(path.name)
        finally:
            os.chdir(place)

    draft.special[image_name(k)] = [
        os.mkfifo,
        make_socket,
        Path.mkdir,
        lambda path: path.symlink_to("/dev/zero"),
        lambda path: path.symlink_to("/dev/stdin"),
        lambda path: path.symlink_to("absent.png"),
        lambda path: path.symlink_to(path.name),
        lambda path: path.symlink_to("/proc/self/mem"),
    ][rng.integers(8)]
    draft.expected, draft.left = "left_out", (image_name(k),)
    return draft


def images_with_company(rng):
    """Files beside the images that are none of them, and other endings."""
    draft = yaml_draft(rng)
    k = int(rng.integers(FRAMES))
    how = rng.integers(5)
    if how == 0:
        draft.files |= {f"depth/._{n:06d}.png": b"\x00\x05\x16\x07" + rng.bytes(80) for n in range(FRAMES)}
    elif how == 1:
        draft.files |= {"depth/.DS_Store": b"x", "depth/Thumbs.db": b"x", "depth/readme.txt": b"x"}
    elif how == 2:
        for n in range(FRAMES):
            draft.files[f"depth/{n:06d}.PNG"] = draft.files.pop(image_name(n))
    elif how == 3:
        draft.files[image_name(k)] += rng.bytes(40)  # behind the end
    else:
        draft.files[image_name(k)] = raw_png(pixels=rows_of(FLOORS[k]), extra=chunk(b"tEXt", b"by\0hand"))
    draft.expected = "same"
    return draft


def names_without_zeros(rng):
    draft = yaml_draft(rng, poses=False)
    pattern = str(
        rng.choice(["{}.png", "depth_{}.png", "{}_depth.png", "frame{}.png", "a{}b.PNG", "100.{}5.png", "d-{}.Png"])
    )
    count = 12
    if pattern == "100.{}5.png":
        pattern, count = "{}.5.png", 12
    draft.files = {f"depth/{pattern.format(k)}": GOOD_IMAGES[k % FRAMES] for k in range(count)}
    poses = [[0.25 * k, 0.0, 0.0] for k in range(count)]
    if rng.random() < 0.5:
        draft.content["poses"] = poses
    else:
        draft.content["poses"] = "poses.txt"
        draft.files["poses.txt"] = "".join(f"{x} {y} {yaw}\n" for x, y, yaw in poses).encode()
    draft.expected, draft.poses = "same", [row[0] for row in poses]
    if rng.random() < 0.3:  # one twin: the order is unknown
        name = next(name for name in draft.files if name.startswith("depth/"))
        draft.files[name.replace("0", "00")] = GOOD_IMAGES[0]
        draft.expected = "refused"
    return draft


# ---------------------------------------------------------------- poses and goals


def text_of(rows) -> str:
    return "".join(" ".join(str(x) for x in row) + "\n" for row in rows)


def wrong_poses(rng):
    draft = yaml_draft(rng, poses=True)
    rows = np.array(POSES)
    k = int(rng.integers(1, FRAMES - 1))
    how = rng.integers(18)
    changed: Any = rows.tolist()
    if how == 0:
        changed = rows[:, :2].reshape(-1, 2).tolist()
    elif how == 1:
        changed = np.concatenate([rows[:, :2].ravel(), [0, 0]]).reshape(-1, 3).tolist()
        draft.expected = "doubted"  # two columns cut again into three
    elif how == 2:
        changed = np.c_[rows, rows[:, :1]].tolist()
    elif how == 3:
        changed = (rows * [1, 1, 180 / np.pi]).tolist()
    elif how == 4:
        changed = (rows * [1000, 1000, 1]).tolist()
    elif how == 5:
        changed = (rows + np.array([5e6, 4e5, 0.0])).tolist()
    elif how == 6:
        changed = (rows + np.array([0.0, 0.0, 1e9])).tolist()
    elif how == 7:
        changed = [str(rows.tolist()), {"x": 1}, 5, True, [[1, 2, "three"]] * FRAMES, [[True, 0, 0]] * FRAMES, []][
            rng.integers(7)
        ]
    elif how == 8:
        changed = rows.ravel().tolist()
    elif how == 9:
        changed[k] = [float("nan"), 0.0, 0.0]
        draft.expected, draft.left = "left_out", (image_name(k),)
    elif how == 10:
        changed[k] = [float(rng.choice([30.0, 500.0, -80.0])), 0.0, 0.0]
        draft.expected, draft.left = "left_out", (image_name(k),)
    elif how == 11:
        changed = changed[:k]
        draft.expected, draft.left = "left_out", tuple(image_name(n) for n in range(k, FRAMES))
    elif how == 12:
        changed += [[0.4 * FRAMES, 0.0, 0.25]]
        draft.expected, draft.left = "left_out", ()
    elif how == 13:
        del draft.files[image_name(k)]
        draft.expected, draft.left = "left_out", (image_name(k),)
        draft.poses = [row[0] for n, row in enumerate(POSES) if n != k]
    elif how == 16:
        changed = rows[:, [2, 0, 1]].tolist()
        draft.expected = "doubted"  # yaw x y
    elif how == 17:
        draft.files[image_name(k)] = draft.files[image_name(k - 1)]
        draft.expected, draft.left = "left_out", (image_name(k),)
    elif how == 14:
        for n in range(k, FRAMES):
            changed[n][0] += 1000.0
        draft.expected = "refused" if 1 < k < FRAMES - 1 or FRAMES - k > 1 else "doubted"
    else:
        for n in range(FRAMES):
            draft.files[f"depth/{'abcde'[n]}.png"] = draft.files.pop(image_name(n))
        changed = changed[:-1]
    draft.content["poses"] = changed
    if isinstance(changed, list) and how not in (7, 8) and rng.random() < 0.5:
        draft.content["poses"] = "poses.txt"
        draft.files["poses.txt"] = text_of(changed).encode()
    return draft


def odd_pose_text(rng):
    draft = yaml_draft(rng, poses=False)
    draft.content["poses"] = "poses.txt"
    text = text_of(POSES)
    how = int(rng.integers(14))
    draft.files["poses.txt"] = [
        codecs.BOM_UTF8 + text.encode(),
        text.encode("utf-16"),
        text.replace(" ", ", ").replace("\n", "\r\n").encode(),
        ("# x y yaw\n\n" + text + "\n# end").encode(),
        text.encode() + b"# caf\xe9\n",
        text.encode() + b"\0\0\0",
        b"x y yaw\n" + text.encode(),
        text.encode().replace(b"0.4", b"0.4m"),
        text.encode().replace(b"0.4", b"9" * 400),
        text.encode().replace(b"0.4", b"0x1p3"),
        text.encode().replace(b"0.4", b"0_4"),
        b"",
        b"0 0 0\n" * 600_000,
        b"0 " * 2_000_000,
    ][how]
    draft.expected = "same" if how < 4 else "refused"
    draft.poses = [row[0] for row in POSES] if how < 4 else None
    return draft


def wrong_goals(rng):
    draft = yaml_draft(rng, poses=True)
    how = rng.integers(6)
    k = int(rng.integers(FRAMES))
    goals: Any = [[2.0 - 0.3 * n, 0.1 * n] for n in range(FRAMES)]
    if how == 0:
        goals[k] = [1e9, 0.0]
    elif how == 1:
        goals = [[3.0, 0.5]] * FRAMES
    elif how == 2:
        goals = [[*goal, 0.0] for goal in goals]
    elif how == 3:
        goals[k] = [float("inf"), 0.0]
        draft.expected, draft.left = "left_out", (image_name(k),)
    elif how == 4:
        goals = (np.array(goals) * 1000).tolist()
    else:
        goals = [goal[0] for goal in goals]
    draft.content["goals"] = goals
    return draft


# ---------------------------------------------------------------- the other layouts


def wrong_tum(rng):
    draft = tum_draft()
    truth, listing = draft.files["groundtruth.txt"].decode(), draft.files["depth.txt"].decode()
    rows = [line.split() for line in truth.splitlines()]
    how = rng.integers(13)
    draft.expected = "refused"
    if how == 0:  # w first
        truth = text_of([[*row[:4], row[7], *row[4:7]] for row in rows])
        draft.expected = "doubted"
    elif how == 1:  # positions and quaternions exchanged
        truth = text_of([[row[0], *row[4:], *row[1:4]] for row in rows])
        draft.expected = "doubted"
    elif how == 2:
        truth = text_of([[float(row[0]) * 1000, *row[1:]] for row in rows])
        draft.expected = "doubted"
    elif how == 3:
        truth = text_of([row[:7] for row in rows])
    elif how == 4:
        truth = text_of([[row[0], *(float(x) * 1000 for x in row[1:4]), *row[4:]] for row in rows])
    elif how == 5:
        listing = listing.replace("depth/100.1", str(rng.choice(["../100.1", "/depth/100.1", "depth/../../100.1"])))
    elif how == 6:
        listing += listing.splitlines()[0] + "\n"
    elif how == 7:
        listing = listing.replace(".png", ".png extra")
    elif how == 8:
        draft.special["depth.txt"] = lambda path: path.symlink_to("/etc/passwd")
        del draft.files["depth.txt"]
    elif how == 9:
        draft.special["groundtruth.txt"] = os.mkfifo
        del draft.files["groundtruth.txt"]
    elif how == 10:
        draft.files |= {name: png(FLOORS[k]) for k, name in enumerate(list(draft.files)[:FRAMES])}  # millimetres
    elif how == 11:
        rng.shuffle(rows)
        truth = text_of(rows)
        draft.expected, draft.poses = "same", [0.3 * k for k in range(FRAMES)]
    else:
        truth = "\ufeff" + truth
        draft.expected, draft.poses = "same", [0.3 * k for k in range(FRAMES)]
    for name, text in (("groundtruth.txt", truth), ("depth.txt", listing)):
        if name in draft.files:
            draft.files[name] = text.encode()
    return draft


def wrong_iplanner(rng):
    draft = iplanner_draft()
    quaternion = optical_quaternion()
    how = rng.integers(14)
    files = draft.files
    odometry = [[0.3 * k, 0.0, 0.4, 0.0, 0.0, 0.0, 1.0] for k in range(FRAMES)]
    if how == 0:
        files["camera_extrinsic.txt"] = str([0.1, 0.0, 0.2, quaternion[3], *quaternion[:3]]).encode()
        draft.expected = "doubted"
    elif how == 1:
        files["camera_extrinsic.txt"] = str([100.0, 0.0, 200.0, *quaternion]).encode()
    elif how == 2:
        files["camera_extrinsic.txt"] = b"0 0 0 0 0 0 0"
    elif how == 3:
        files["camera_extrinsic.txt"] *= 2
    elif how == 4:
        files["depth_intrinsic.txt"] = b"60 0 0 0 0 60 0 0 59.5 44.5 1 0"
    elif how == 5:
        files["depth_intrinsic.txt"] = b"60 0 59.5 0\n0 60 44.5 0\n0 0 1 0\n"
    elif how == 6:
        files["depth_intrinsic.txt"] = files["depth_intrinsic.txt"].replace(
            b"60.0", str(rng.choice(["nan", "-60", "9e9", "0"])).encode()
        )
    elif how == 7:
        del files[str(rng.choice(["depth_intrinsic.txt", "camera_extrinsic.txt"]))]
    elif how == 8:
        odometry = [[*row[:3], 1.0, 0.0, 0.0, 0.0] for row in odometry]  # w first: the body on its back
        draft.expected = "doubted"
    elif how == 9:
        odometry = [[1000 * x for x in row[:3]] + row[3:] for row in odometry]
    elif how == 10:
        odometry = odometry[:-1]
        draft.expected, draft.left = "left_out", (f"depth/{FRAMES - 1}.png",)
    elif how == 11:
        odometry = []
    elif how == 12:
        draft.special["odom_ground_truth.txt"] = os.mkfifo
        files.pop("odom_ground_truth.txt")
    else:
        files |= {f"depth/._{k}.png": b"\x00\x05\x16\x07" + bytes(64) for k in range(FRAMES)}
        draft.expected, draft.poses = "same", [row[0] for row in odometry]
    if "odom_ground_truth.txt" in files:
        files["odom_ground_truth.txt"] = "".join(f"{row}\n" for row in odometry).encode()
    return draft


MAKERS: dict[str, Callable[[np.random.Generator], Draft]] = {
    maker.__name__: maker
    for maker in (
        odd_value, damaged_text, hostile_yaml, readable_yaml, path_that_leaves, wrong_mount, wrong_scale, turned_images,
        wrong_intrinsics, damaged_image, image_that_is_no_file, images_with_company, names_without_zeros, wrong_poses,
        odd_pose_text, wrong_goals, wrong_tum, wrong_iplanner,
    )
}  # fmt: skip


def judge(draft: Draft, folder: Path) -> str | None:
    """What is wrong with how a draft is received; None if nothing is."""
    place = draft.write(folder)
    given = Intrinsics(**INTRINSICS) if draft.given else None
    begin = time.process_time()
    report = validate_recording(place, given)
    seconds = time.process_time() - begin
    if seconds > SECONDS:
        return f"took {seconds:.0f} s"
    sentences = [*(f"{p.file} {p.problem}" for p in report.problems), *report.assumptions, report.fatal or ""]
    for sentence in sentences:
        if not sentence.isprintable() or "root:" in sentence or len(sentence) > 900:
            return f"says {sentence[:200]!r}"
    try:
        frames = frames_from_recording(place, 1, intrinsics=given, say=lambda _: None)
        if not report.is_usable or len(frames) != len(report.usable):
            return "training takes what the validator refuses"
    except InputError as error:
        if report.fatal is None or report.fatal not in str(error):
            return f"training refuses with another sentence: {error}"
        frames = None
    verdict = _verdict(draft, report, place)
    known = None if frames is None or draft.poses is None else np.array(draft.poses)
    if verdict is None and known is not None and not np.allclose(frames.poses[:, 0], known, atol=1e-4):
        return f"has the poses of other images: {frames.poses[:, 0]}"
    return verdict and f"{verdict}; report: {[s for s in sentences if s]}"


def _verdict(draft: Draft, report, place: Path) -> str | None:
    images = sum(name.lower().endswith(".png") and "/." not in name for name in {**draft.files, **draft.special})
    if draft.expected == "refused":
        return None if report.fatal else "called usable"
    if draft.expected == "doubted":
        return None if report.fatal or report.problems else "called usable without a word"
    if draft.expected == "same":
        return None if len(report.usable) == images and not report.problems else "not as usable as it is"
    if draft.expected == "left_out":
        known = {*draft.files, *draft.special}
        wanted = {name for name in known if name.lower().endswith(".png") and "/." not in name} - set(draft.left)
        named = {problem.file for problem in report.problems}
        right = set(report.usable) == wanted and named >= set(draft.left) and bool(report.problems)
        return None if right else f"uses {report.usable}, not {sorted(wanted)}"
    if report.fatal:
        return None
    try:
        content = yaml.safe_load((place / "recording.yaml").read_bytes())
        written = Intrinsics(**content["intrinsics"])
        scale = float(content.get("depth_scale", 0.001))
    except Exception as error:
        return f"read what an independent parser refuses ({error})"
    same = report.intrinsics == written and np.isclose(report.depth_scale, scale)
    return None if same else f"read {report.intrinsics}, {report.depth_scale}"


def run(count: int, seed: int) -> list[str]:
    """Judge so many cases, the kinds in turn; returns what is wrong, one sentence a case."""
    wrong = []
    kinds = list(MAKERS)
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / "secret.txt").write_text("root: 1\n")
        for number in range(count):
            kind = kinds[number % len(kinds)]
            draft = MAKERS[kind](np.random.default_rng([seed, number]))
            try:
                verdict = judge(draft, Path(place) / f"case{number}")
            except Exception as error:
                verdict = f"raises {type(error).__name__}: {error}"
            if verdict:
                wrong.append(f"{kind} {seed}/{number} ({draft.expected}): {verdict}")
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    wrong = run(options.count, options.seed)
    print("\n".join(wrong))
    print(f"{len(wrong)} of {options.count} wrong:", dict(Counter(sentence.split()[0] for sentence in wrong)))
    return bool(wrong)


if __name__ == "__main__":
    raise SystemExit(main())
