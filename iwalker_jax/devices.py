"""Which of this process's devices a program runs on."""

import jax

from iwalker_jax.errors import InputError


def chosen_devices(count: int | None = None) -> list[jax.Device]:
    """The first `count` devices of this process, all by default.

    Raises:
        InputError: if fewer devices are present.
    """
    present = jax.local_devices()
    count = len(present) if count is None else count
    if not 1 <= count <= len(present):
        raise InputError(f"{count} devices were asked for but {len(present)} are present; see jax.local_devices().")
    return present[:count]
