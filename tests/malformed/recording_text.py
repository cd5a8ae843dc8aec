"""Malformed recording.yaml, and odd ones that are fine."""

import codecs
import os
from typing import Any

import numpy as np
import yaml

from tests.malformed.drafts import Draft, yaml_draft

ODD_VALUES = (
    "9" * 400, "-" + "9" * 5000, "1e999", ".nan", "-.inf", "-1", "0", "true", "null", "", "sixty", "[1]", "{a: 1}",
    "1:30", "0x1F", "'120'", '"1\\0"', "!!int 5", "1_20", "120 px", "1e-400", "2023-01-01", "&a 5",
)  # fmt: skip


def odd_value(rng: np.random.Generator) -> Draft:
    draft = yaml_draft(rng, mount=True)
    group = rng.choice(["intrinsics", "mount", ""])
    key = rng.choice(list(draft.content[group] if group else ["depth_scale"]))
    (draft.content[group] if group else draft.content)[key] = "PUT-IT-HERE"
    value = str(rng.choice(ODD_VALUES))
    draft.yaml(yaml.safe_dump(draft.content).replace("PUT-IT-HERE", value))
    if key in ("cx", "cy", "roll_deg", "pitch_deg") and value in ("0", "-1", "1e-400"):
        draft.expected = "as_written"  # a roll or pitch near 0 may be within what is doubted
    return draft


def damaged_text(rng: np.random.Generator) -> Draft:
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


def hostile_yaml(rng: np.random.Generator) -> Draft:
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


def readable_yaml(rng: np.random.Generator) -> Draft:
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


def path_that_leaves(rng: np.random.Generator) -> Draft:
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
