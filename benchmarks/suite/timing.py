"""Wall times of calls, alone or in turns."""

import statistics
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import jax

_CACHE_HIT, _CACHE_MISS = "/jax/compilation_cache/cache_hits", "/jax/compilation_cache/cache_misses"


class Times(NamedTuple):
    """Seconds of a call.

    Attributes:
        first: of its first run, which compiles.
        cached: whether all that this run would have compiled came from the compilation cache.
        turns: of each run after it.
        result: of the first run.
    """

    first: float
    cached: bool
    turns: tuple[float, ...]
    result: Any = None

    @property
    def best(self) -> float:
        """Shortest turn [s]."""
        return min(self.turns)

    @property
    def median(self) -> float:
        """Median turn [s]."""
        return statistics.median(self.turns)


def once(call: Callable, *arguments: Any) -> tuple[Any, float]:
    """A call's result, waited for, and the seconds that it took."""
    begin = time.perf_counter()
    result = jax.block_until_ready(call(*arguments))
    return result, time.perf_counter() - begin


def first_run(call: Callable[[], Any]) -> tuple[Any, float, bool]:
    """Result and seconds of a call that may compile, and whether the compilation cache held all of its programs."""
    seen: list[str] = []

    def listen(event: str, **_: Any) -> None:
        seen.append(event)

    jax.monitoring.register_event_listener(listen)
    try:
        result, taken = once(call)
    finally:
        jax.monitoring.unregister_event_listener(listen)
    return result, taken, _CACHE_HIT in seen and _CACHE_MISS not in seen


def in_turns(calls: Mapping[str, Callable[[], Any]], repeats: int) -> dict[str, Times]:
    """Times of calls by name, taken in turns so that a busy machine slows all of them alike; first runs are apart.

    Every second round goes backwards: what a call leaves in the processor's caches helps no other one always.
    """
    first = {name: first_run(call) for name, call in calls.items()}
    turns: dict[str, list[float]] = {name: [] for name in calls}
    for number in range(repeats):
        for name in list(calls) if number % 2 == 0 else reversed(list(calls)):
            turns[name].append(once(calls[name])[1])
    return {name: Times(taken, cached, tuple(turns[name]), result) for name, (result, taken, cached) in first.items()}


def timed(call: Callable, *arguments: Any, repeats: int) -> Times:
    """Times of one call."""
    return in_turns({"alone": partial(call, *arguments)}, repeats)["alone"]
