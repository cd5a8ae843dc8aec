"""Recordings in the layouts of TUM RGB-D and iPlanner, with something wrong."""

import os

import numpy as np

from tests.malformed.drafts import FLOORS, FRAMES, Draft, iplanner_draft, optical_quaternion, png, tum_draft
from tests.malformed.recording_poses import text_of


def odd_listing(draft: Draft, way: int, rng: np.random.Generator) -> None:
    """depth.txt with names that leave the folder, a line twice, more columns, or a link to another's file."""
    listing = draft.files["depth.txt"].decode()
    if way == 0:
        listing = listing.replace("depth/100.1", str(rng.choice(["../100.1", "/depth/100.1", "depth/../../100.1"])))
    elif way == 1:
        listing += listing.splitlines()[0] + "\n"
    elif way == 2:
        listing = listing.replace(".png", ".png extra")
    draft.files["depth.txt"] = listing.encode()
    if way == 3:
        draft.special["depth.txt"] = lambda path: path.symlink_to("/etc/passwd")
        del draft.files["depth.txt"]


def odd_truth(draft: Draft, way: int, rng: np.random.Generator) -> None:
    """groundtruth.txt with columns in another order, missing or in another unit, or lines in another order."""
    truth = draft.files["groundtruth.txt"].decode()
    rows = [line.split() for line in truth.splitlines()]
    if way == 0:  # w first
        truth, draft.expected = text_of([[*row[:4], row[7], *row[4:7]] for row in rows]), "doubted"
    elif way == 1:  # positions and quaternions exchanged
        truth, draft.expected = text_of([[row[0], *row[4:], *row[1:4]] for row in rows]), "doubted"
    elif way == 2:
        truth, draft.expected = text_of([[float(row[0]) * 1000, *row[1:]] for row in rows]), "doubted"
    elif way == 3:
        truth = text_of([row[:7] for row in rows])
    elif way == 4:
        truth = text_of([[row[0], *(float(x) * 1000 for x in row[1:4]), *row[4:]] for row in rows])
    elif way == 11:
        rng.shuffle(rows)
        truth = text_of(rows)
    elif way == 12:
        truth = "\ufeff" + truth
    if way >= 11:
        draft.expected, draft.poses = "same", [0.3 * k for k in range(FRAMES)]
    draft.files["groundtruth.txt"] = truth.encode()


def wrong_tum(rng: np.random.Generator) -> Draft:
    draft = tum_draft()
    way = int(rng.integers(13))
    if way == 9:
        draft.special["groundtruth.txt"] = os.mkfifo
        del draft.files["groundtruth.txt"]
    elif way == 10:
        draft.files |= {name: png(FLOORS[k]) for k, name in enumerate(list(draft.files)[:FRAMES])}  # millimetres
    elif 5 <= way <= 8:
        odd_listing(draft, way - 5, rng)
    else:
        odd_truth(draft, way, rng)
    return draft


def odd_camera(draft: Draft, way: int, rng: np.random.Generator) -> None:
    """Intrinsics and extrinsics in another order, of another size, or that cannot be."""
    files, quaternion = draft.files, optical_quaternion()
    if way == 0:
        files["camera_extrinsic.txt"] = str([0.1, 0.0, 0.2, quaternion[3], *quaternion[:3]]).encode()
        draft.expected = "doubted"
    elif way == 1:
        files["camera_extrinsic.txt"] = str([100.0, 0.0, 200.0, *quaternion]).encode()
    elif way == 2:
        files["camera_extrinsic.txt"] = b"0 0 0 0 0 0 0"
    elif way == 3:
        files["camera_extrinsic.txt"] *= 2
    elif way == 4:
        files["depth_intrinsic.txt"] = b"60 0 0 0 0 60 0 0 59.5 44.5 1 0"
    elif way == 5:
        files["depth_intrinsic.txt"] = b"60 0 59.5 0\n0 60 44.5 0\n0 0 1 0\n"
    elif way == 6:
        number = str(rng.choice(["nan", "-60", "9e9", "0"])).encode()
        files["depth_intrinsic.txt"] = files["depth_intrinsic.txt"].replace(b"60.0", number)
    else:
        del files[str(rng.choice(["depth_intrinsic.txt", "camera_extrinsic.txt"]))]


def odd_odometry(draft: Draft, way: int) -> None:
    """Poses in another order or unit, too few of them, or none; and a Mac's files beside the images, which are fine."""
    odometry = [[0.3 * k, 0.0, 0.4, 0.0, 0.0, 0.0, 1.0] for k in range(FRAMES)]
    if way == 8:
        odometry = [[*row[:3], 1.0, 0.0, 0.0, 0.0] for row in odometry]  # w first: the body on its back
        draft.expected = "doubted"
    elif way == 9:
        odometry = [[1000 * x for x in row[:3]] + row[3:] for row in odometry]
    elif way == 10:
        odometry = odometry[:-1]
        draft.expected, draft.left = "left_out", (f"depth/{FRAMES - 1}.png",)
    elif way == 11:
        odometry = []
    elif way == 13:
        draft.files |= {f"depth/._{k}.png": b"\x00\x05\x16\x07" + bytes(64) for k in range(FRAMES)}
        draft.expected, draft.poses = "same", [row[0] for row in odometry]
    draft.files["odom_ground_truth.txt"] = "".join(f"{row}\n" for row in odometry).encode()


def wrong_iplanner(rng: np.random.Generator) -> Draft:
    draft = iplanner_draft()
    way = int(rng.integers(14))
    if way == 12:
        draft.special["odom_ground_truth.txt"] = os.mkfifo
        del draft.files["odom_ground_truth.txt"]
    elif way < 8:
        odd_camera(draft, way, rng)
        odd_odometry(draft, 0)
    else:
        odd_odometry(draft, way)
    return draft
