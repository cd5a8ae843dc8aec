"""The machine's floor: an empty step of a compiled loop, a matrix product, and the memory's bandwidth.

Run with `python -m benchmarks.floor`. Other figures are read against it: nothing that waits for N steps in a
row, does N operations or moves N bytes is faster than these.
"""

from collections.abc import Iterator
from functools import partial

from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import jax
import jax.numpy as jnp
import tyro

from benchmarks.suite.alone import Options, present
from benchmarks.suite.contest import Contender, contest
from benchmarks.suite.figures import Floor, Group, Result

STEPS = 100_000
SIDE = 1024
NUMBERS = 1 << 25
"""Of each array that is moved: far more than the processor's caches hold."""

_STEP, _PRODUCT, _BYTE, _CALL = "empty step of a loop", "matrix product", "sum of two arrays", "call of nothing"


def count(steps: int, start: jax.Array) -> jax.Array:
    """A loop whose step waits for the last one's number: adding whole ones would be summed up when it is compiled."""
    return jax.lax.scan(lambda number, _: (0.5 * number + 1.0, None), start, None, length=steps)[0]


def measure(options: Options) -> Iterator[Group]:
    """All figures of this benchmark."""
    side, numbers = (SIDE // 2, NUMBERS // 4) if options.quick else (SIDE, NUMBERS)
    matrix, array = jnp.ones((side, side), jnp.float32), jnp.ones(numbers, jnp.float32)
    zero = jnp.zeros((), jnp.float32)
    rows = [
        Contender(_STEP, "ours", partial(jax.jit(partial(count, STEPS)), zero), STEPS),
        Contender(_CALL, "ours", partial(jax.jit(lambda number: number + 1), zero)),
        Contender(_PRODUCT, "ours", partial(jax.jit(jnp.matmul), matrix, matrix), 2 * side**3),
        Contender(_BYTE, "ours", partial(jax.jit(jnp.add), array, array), 3 * array.nbytes),
    ]
    yield contest("Step and call of a program; a floating-point operation; a byte", "each", rows, 9)


def floor_of(result: Result) -> Floor | None:
    """The floor from this benchmark's figures, by the best turns; None if they are not there."""
    best = {row.name: row.best for group in result.groups for row in group.rows}
    if not {_STEP, _PRODUCT, _BYTE} <= set(best):
        return None
    return Floor(step=best[_STEP], flops=1 / best[_PRODUCT], bandwidth=1 / best[_BYTE])


if __name__ == "__main__":
    options = tyro.cli(Options, description=__doc__)
    present(measure(options), options)
