"""The face of the film room: every name is there, and looking at it imports neither mujoco nor JAX."""

import subprocess
import sys
from pathlib import Path

import pytest

from iwalker_jax import film

SCRIPT = """
import sys
import iwalker_jax.film as film
from iwalker_jax.film import configure_rendering
configure_rendering()
dir(film)
print(sorted(name for name in ("jax", "mujoco", "numpy", "cv2") if name in sys.modules))
"""


def test_rendering_is_configured_before_anything_heavy_is_imported():
    run = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=60, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == "[]"


def test_every_name_is_there_and_no_other():
    rooms = {file.stem for file in Path(film.__file__).parent.glob("*.py")}
    shown = {name for name in dir(film) if not name.startswith("_")} - rooms - {"TYPE_CHECKING", "lazy_names"}
    assert set(film.__all__) == shown and len(set(film.__all__)) == len(film.__all__)
    others = {name: getattr(film, name) for name in film.__all__ if not name.isupper()}
    assert [value for name, value in others.items() if value.__name__ != name] == []
    with pytest.raises(AttributeError, match="no attribute 'cinema'"):
        film.cinema  # noqa: B018
