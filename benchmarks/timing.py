"""Wall times of calls, alone or in turns."""

import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax


class Times(NamedTuple):
    """Seconds of a call: of its first run, which compiles, and the best and the median of those after it."""

    first: float
    best: float
    median: float

    def each(self, count: int) -> "Times":
        """Seconds of each of the `count` items that a call handles."""
        return Times(*(seconds / count for seconds in self))

    def milliseconds(self) -> str:
        """Best (median) [ms], for a table."""
        return f"{1e3 * self.best:.2f} ({1e3 * self.median:5.2f})"


def once(call: Callable, *arguments: Any) -> tuple[Any, float]:
    """A call's result, waited for, and the seconds that it took."""
    begin = time.perf_counter()
    result = jax.block_until_ready(call(*arguments))
    return result, time.perf_counter() - begin


def compiled(program: Any, *arguments: Any) -> tuple[Callable, float]:
    """A jitted function for arguments or their shapes, compiled or loaded from the cache, and the seconds it took."""
    return once(lambda: program.lower(*arguments).compile())


def in_turns(calls: dict[str, Callable[[], object]], repeats: int) -> dict[str, Times]:
    """Times of calls by name, taken in turns so that a busy machine slows all of them alike; first runs are apart."""
    first = {name: once(call)[1] for name, call in calls.items()}
    rounds = [{name: once(call)[1] for name, call in calls.items()} for _ in range(repeats)]
    taken = {name: [turn[name] for turn in rounds] for name in calls}
    return {name: Times(first[name], min(times), statistics.median(times)) for name, times in taken.items()}


def timed(call: Callable, *arguments: Any, repeats: int) -> Times:
    """Times of one call."""
    return in_turns({"alone": partial(call, *arguments)}, repeats)["alone"]
