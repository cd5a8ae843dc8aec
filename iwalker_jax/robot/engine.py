"""The one door to MJX; quiet, because importing it prints that an optional back end is absent."""

import contextlib
import io

with contextlib.redirect_stdout(io.StringIO()):
    from mujoco import mjx

__all__ = ["mjx"]
