"""Shared test setup: the library's own process settings, before anything imports JAX."""

import os
from pathlib import Path

import pytest

from iwalker_jax.film.headless import configure_rendering
from iwalker_jax.runtime.settings import configure_runtime

configure_runtime(host_devices=2)
configure_rendering()

import jax  # noqa: E402
import jaxtyping  # noqa: E402

import tests.type_checker  # noqa: E402, F401

# Every module imported from here on has its types and shapes checked at each call, unless that is not wanted.
if os.environ.get("IWALKER_CHECK_TYPES", "1") != "0":
    jaxtyping.install_import_hook("iwalker_jax", "tests.type_checker.checked")

from bruce_model import load_mujoco  # noqa: E402
from iwalker_jax.navigation.body_volume import load_body_volume  # noqa: E402

jax.config.update("jax_numpy_dtype_promotion", "standard")

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "aims_slam"


@pytest.fixture(scope="module", autouse=True)
def freed_programs():
    """Drop a module's compiled programs after it: each holds memory maps, of which a process may have only so many."""
    yield
    jax.clear_caches()


@pytest.fixture
def x64():
    """Run one test in double precision."""
    with jax.enable_x64(True):
        yield


@pytest.fixture
def unchecked_types():
    """Let a call that is wrong on purpose reach the function's own check, although types and shapes are checked."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", before)


@pytest.fixture(scope="session")
def bruce_mujoco():
    """BRUCE as C MuJoCo has it; not to be changed."""
    return load_mujoco()


@pytest.fixture(scope="session")
def bruce_volume(bruce_mujoco):
    """The volume of BRUCE's body."""
    return load_body_volume(bruce_mujoco)


@pytest.fixture(scope="session")
def real_depth_folder() -> Path:
    """Folder of real RealSense frames; the test is skipped where it is absent."""
    folder = SHARED_DATA / "depth"
    if not folder.is_dir():
        pytest.skip("the real depth frames are not on this machine")
    return folder
