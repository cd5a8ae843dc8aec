"""Damaged images, files that are none, names in another order, and images that only look odd."""

import io
import os
import socket
import struct
import zlib
from pathlib import Path

import numpy as np

from tests.data.recording_folders import HEIGHT, WIDTH
from tests.malformed.drafts import FLOORS, FRAMES, GOOD_IMAGES, Draft, image_name, png, yaml_draft


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def raw_png(width=WIDTH, height=HEIGHT, bits=16, colour=0, interlace=0, pixels=b"", extra=b"") -> bytes:
    """A PNG made by hand, every checksum right."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, interlace))
    return b"\x89PNG\r\n\x1a\n" + header + extra + chunk(b"IDAT", zlib.compress(pixels, 1)) + chunk(b"IEND", b"")


def rows_of(image: np.ndarray, filter_type: int = 0) -> bytes:
    return b"".join(bytes([filter_type]) + row.astype(">u2").tobytes() for row in image)


def damaged_image(rng: np.random.Generator) -> Draft:
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


def saved(array: np.ndarray, shape: tuple[int, ...] | None = None) -> bytes:
    """A .npy file, or one that claims another shape."""
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    content = stream.getvalue()
    return content if shape is None else content.replace(str(array.shape).encode(), str(shape).encode())


def damaged_array(rng: np.random.Generator) -> Draft:
    """Frames in metres as .npy files, one of them damaged or of another kind."""
    draft = yaml_draft(rng)
    assert draft.content is not None
    del draft.content["depth_scale"]
    metres = [(floor / 1000.0).astype(rng.choice(["<f4", "<f8", ">f4"])) for floor in FLOORS]
    names = [image_name(k).replace(".png", ".npy") for k in range(FRAMES)]
    draft.files = dict(zip(names, map(saved, metres)))
    k = int(rng.integers(FRAMES))
    good, depth = draft.files[names[k]], metres[k]
    bad = [
        good[: int(rng.integers(len(good)))],
        good + b"\0",
        good[int(rng.integers(1, len(good))) :],
        b"",
        rng.bytes(500),
        b"\x93NUMPY" + rng.bytes(300),
        GOOD_IMAGES[k],
        saved(np.array([{"a": 1}, None], object)),
        saved(FLOORS[k]),
        saved(depth > 1.0),
        saved(depth.astype(complex)),
        saved(1000.0 * depth),
        saved(np.full_like(depth, np.nan)),
        saved(np.zeros_like(depth)),
        saved(depth[:-1]),
        saved(depth[None]),
        saved(depth.T),
        saved(depth, (2**40, 2**40)),
        saved(depth, (-HEIGHT, -WIDTH)),
        saved(np.array(["a", "b"])),
        saved(depth.astype(np.float32).view([("z", "<f4")])),
    ]
    draft.files[names[k]] = bad[rng.integers(len(bad))]
    draft.expected, draft.left = "left_out", (names[k],)
    return draft


def image_that_is_no_file(rng: np.random.Generator) -> Draft:
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


def images_with_company(rng: np.random.Generator) -> Draft:
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


def names_without_zeros(rng: np.random.Generator) -> Draft:
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
