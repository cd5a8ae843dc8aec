"""Examples run as a user runs them, and what they leave."""

import re
from pathlib import Path

import cv2

from tests.fresh_process import ROOT, printed_by

EXAMPLES = ROOT / "examples"


def run(name: str, folder: Path, *options: str) -> str:
    """What `python examples/NAME.py` prints in a folder."""
    return printed_by(str(EXAMPLES / f"{name}.py"), *options, folder=folder)


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text)]


def is_picture(file: Path) -> bool:
    image = cv2.imread(str(file))
    return image is not None and image.std() > 5
