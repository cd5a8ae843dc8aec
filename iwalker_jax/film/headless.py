"""Drawing with MuJoCo on machines without a screen; chosen before mujoco is imported, so this module imports little."""

import ctypes
import os
import sys

NO_RENDERING = (
    "MuJoCo cannot draw on this machine ({reason}); install the system packages libegl1 and libgl1-mesa-dri (or "
    "libosmesa6 with MUJOCO_GL=osmesa), or go without the video."
)
"""What is said when there is nothing to draw with."""

_OFFSCREEN = (("egl", "libEGL.so.1"), ("osmesa", "libOSMesa.so.8"))


def configure_rendering() -> None:
    """Make MuJoCo draw without a screen: MUJOCO_GL becomes egl, else osmesa, whichever library can be loaded.

    A user's own MUJOCO_GL wins. Nothing is changed where there is a screen, or where neither library is found: the
    machine can do everything but draw, and drawing then says what to install.

    Raises:
        RuntimeError: if mujoco has already been imported, because the choice would silently not apply.
    """
    if "MUJOCO_GL" in os.environ or has_screen():
        return
    if "mujoco" in sys.modules:
        raise RuntimeError(
            "configure_rendering() came after `import mujoco`; call it first so that its choice applies."
        )
    for backend, library in _OFFSCREEN:
        try:
            ctypes.CDLL(library)
        except OSError:
            continue
        os.environ["MUJOCO_GL"] = backend
        return


def has_screen() -> bool:
    """Whether windows can be opened; taken for granted on systems other than Linux."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def missing_backend() -> str | None:
    """Why MuJoCo has nothing to draw with in this process, or None if it has a screen or an offscreen backend."""
    backend = os.environ.get("MUJOCO_GL", "").lower().strip()
    if backend in ("egl", "osmesa") or (has_screen() and backend not in ("disable", "disabled", "off", "false", "0")):
        return None
    return f"MUJOCO_GL is {backend!r}" if backend else "there is no screen, and neither EGL nor OSMesa was chosen"
