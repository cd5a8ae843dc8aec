"""Malformed recordings: each case is one good recording with one thing wrong, and what must come of it.

`refused` (unusable, with a sentence), `left_out` (the named images only), `doubted` (refused, or a problem is named),
`same` (as usable as without the change), or `as_written` (refused, or read as an independent parser reads it).
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import yaml

from iwalker_jax.data import RecordingReport, frames_from_recording, validate_recording
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics
from tests.data.recording_folders import INTRINSICS
from tests.malformed import recording_images, recording_layouts, recording_numbers, recording_poses, recording_text
from tests.malformed.drafts import Draft
from tests.malformed.kinds import Kind

MAKERS: dict[str, Callable[[np.random.Generator], Draft]] = {
    maker.__name__: maker
    for maker in (
        recording_text.odd_value,
        recording_text.damaged_text,
        recording_text.hostile_yaml,
        recording_text.readable_yaml,
        recording_text.path_that_leaves,
        recording_numbers.wrong_mount,
        recording_numbers.wrong_scale,
        recording_numbers.turned_images,
        recording_numbers.wrong_intrinsics,
        recording_images.damaged_image,
        recording_images.damaged_array,
        recording_images.image_that_is_no_file,
        recording_images.images_with_company,
        recording_images.names_without_zeros,
        recording_poses.wrong_poses,
        recording_poses.odd_pose_text,
        recording_poses.wrong_goals,
        recording_layouts.wrong_tum,
        recording_layouts.wrong_iplanner,
    )
}


def judge(draft: Draft, folder: Path) -> str | None:
    """What is wrong with the report on a draft, or with the frames that training takes of it; None if nothing is."""
    place = draft.write(folder)
    given = Intrinsics(**INTRINSICS) if draft.given else None
    report = validate_recording(place, given)
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


def _verdict(draft: Draft, report: RecordingReport, place: Path) -> str | None:
    images = sum(name.lower().endswith(".png") and "/." not in name for name in {**draft.files, **draft.special})
    if draft.expected == "refused":
        return None if report.fatal else "called usable"
    if draft.expected == "doubted":
        return None if report.fatal or report.problems else "called usable without a word"
    if draft.expected == "same":
        return None if len(report.usable) == images and not report.problems else "not as usable as it is"
    if draft.expected == "left_out":
        known = {*draft.files, *draft.special}
        wanted = {name for name in known if name.lower().endswith((".png", ".npy")) and "/." not in name} - set(
            draft.left
        )
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


def receive(maker: Callable[[np.random.Generator], Draft], rng: np.random.Generator, folder: Path) -> str | None:
    """What is wrong with how a draft is received; None if nothing is."""
    (folder / "secret.txt").write_text("root: 1\n")
    draft = maker(rng)
    wrong = judge(draft, folder / "case")
    return wrong and f"({draft.expected}) {wrong}"


KINDS: dict[str, Kind] = {name: partial(receive, maker) for name, maker in MAKERS.items()}
