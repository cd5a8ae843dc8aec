"""Poses and goals that are not those of the images, and odd texts of them."""

import codecs
from collections.abc import Sequence
from typing import Any

import numpy as np

from tests.malformed.drafts import FRAMES, POSES, Draft, image_name, yaml_draft


def text_of(rows: Sequence[Sequence[Any]]) -> str:
    """Rows of numbers as a text file holds them."""
    return "".join(" ".join(str(x) for x in row) + "\n" for row in rows)


def leave_out(draft: Draft, *frames: int) -> None:
    """Expect that just these frames are left out."""
    draft.expected, draft.left = "left_out", tuple(image_name(n) for n in frames)


def cut_again(draft: Draft, rows: np.ndarray, k: int, rng: np.random.Generator) -> Any:
    """Two columns cut again into three."""
    draft.expected = "doubted"
    return np.concatenate([rows[:, :2].ravel(), [0, 0]]).reshape(-1, 3).tolist()


def no_rows_at_all(draft: Draft, rows: np.ndarray, k: int, rng: np.random.Generator) -> Any:
    """Something else than rows of three numbers."""
    others: list[Any] = [str(rows.tolist()), {"x": 1}, 5, True, [[1, 2, "three"]] * FRAMES, [[True, 0, 0]] * FRAMES, []]
    return others[rng.integers(7)]


def one_unknown(draft: Draft, rows: np.ndarray, k: int, rng: np.random.Generator) -> Any:
    leave_out(draft, k)
    return [[float("nan"), 0.0, 0.0] if n == k else row for n, row in enumerate(rows.tolist())]


def one_far_away(draft: Draft, rows: np.ndarray, k: int, rng: np.random.Generator) -> Any:
    leave_out(draft, k)
    away = [float(rng.choice([30.0, 500.0, -80.0])), 0.0, 0.0]
    return [away if n == k else row for n, row in enumerate(rows.tolist())]


def too_few(draft: Draft, rows: np.ndarray, k: int, rng: np.random.Generator) -> Any:
    leave_out(draft, *range(k, FRAMES))
    return rows.tolist()[:k]


def too_many(draft: Draft, rows: np.ndarray, k: int, rng: np.random.Generator) -> Any:
    leave_out(draft)
    return [*rows.tolist(), [0.4 * FRAMES, 0.0, 0.25]]


def image_missing(draft: Draft, rows: np.ndarray, k: int, rng: np.random.Generator) -> Any:
    del draft.files[image_name(k)]
    leave_out(draft, k)
    draft.poses = [row[0] for n, row in enumerate(POSES) if n != k]
    return rows.tolist()


def a_jump(draft: Draft, rows: np.ndarray, k: int, rng: np.random.Generator) -> Any:
    draft.expected = "refused" if 1 < k < FRAMES - 1 or FRAMES - k > 1 else "doubted"
    return (rows + np.where(np.arange(FRAMES)[:, None] >= k, [1000.0, 0.0, 0.0], 0.0)).tolist()


def names_without_numbers(draft: Draft, rows: np.ndarray, k: int, rng: np.random.Generator) -> Any:
    for n in range(FRAMES):
        draft.files[f"depth/{'abcde'[n]}.png"] = draft.files.pop(image_name(n))
    return rows.tolist()[:-1]


def yaw_first(draft: Draft, rows: np.ndarray, k: int, rng: np.random.Generator) -> Any:
    draft.expected = "doubted"
    return rows[:, [2, 0, 1]].tolist()


def image_twice(draft: Draft, rows: np.ndarray, k: int, rng: np.random.Generator) -> Any:
    draft.files[image_name(k)] = draft.files[image_name(k - 1)]
    leave_out(draft, k)
    return rows.tolist()


def wrong_poses(rng: np.random.Generator) -> Draft:
    draft = yaml_draft(rng, poses=True)
    k = int(rng.integers(1, FRAMES - 1))
    ways = (
        lambda draft, rows, k, rng: rows[:, :2].reshape(-1, 2).tolist(),
        cut_again,
        lambda draft, rows, k, rng: np.c_[rows, rows[:, :1]].tolist(),
        lambda draft, rows, k, rng: (rows * [1, 1, 180 / np.pi]).tolist(),
        lambda draft, rows, k, rng: (rows * [1000, 1000, 1]).tolist(),
        lambda draft, rows, k, rng: (rows + np.array([5e6, 4e5, 0.0])).tolist(),
        lambda draft, rows, k, rng: (rows + np.array([0.0, 0.0, 1e9])).tolist(),
        no_rows_at_all,
        lambda draft, rows, k, rng: rows.ravel().tolist(),
        one_unknown,
        one_far_away,
        too_few,
        too_many,
        image_missing,
        a_jump,
        names_without_numbers,
        yaw_first,
        image_twice,
    )
    way = rng.integers(len(ways))
    changed = ways[way](draft, np.array(POSES), k, rng)
    draft.content["poses"] = changed
    if isinstance(changed, list) and way not in (7, 8) and rng.random() < 0.5:
        draft.content["poses"] = "poses.txt"
        draft.files["poses.txt"] = text_of(changed).encode()
    return draft


def odd_pose_text(rng: np.random.Generator) -> Draft:
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


def wrong_goals(rng: np.random.Generator) -> Draft:
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
