"""Figures: rows of contenders that took turns, with their accuracy, and how they compare. Nothing here needs JAX."""

import dataclasses
import math
import statistics
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from iwalker_jax.errors import InputError

Kind = Literal["ours", "peer"]


@dataclass(frozen=True)
class Work:
    """The least that any way of one item must do, from which the machine's floor of its time follows.

    Attributes:
        flops: multiplications and additions.
        bytes: that are read or written once.
        steps: steps that wait for each other, in a loop of a compiled program.
    """

    flops: float = 0.0
    bytes: float = 0.0
    steps: float = 0.0


@dataclass(frozen=True)
class Floor:
    """How fast this machine is at the simplest things.

    Attributes:
        step: [s] of an empty step of `jax.lax.scan`.
        flops: operations a second of a matrix product in single precision.
        bandwidth: bytes a second that a sum of two arrays reads and writes.
    """

    step: float
    flops: float
    bandwidth: float

    def seconds(self, work: Work) -> float:
        """The least time of some work: of its slowest part, the others going on beside it."""
        return max(work.flops / self.flops, work.bytes / self.bandwidth, work.steps * self.step)


@dataclass(frozen=True)
class Row:
    """What one contender took for one item.

    Attributes:
        name: of the contender.
        kind: ours, or a peer's.
        turns: [s an item], in the order of the rounds, which all rows of a group share.
        first: [s] of the whole first call, which compiles; None for what compiles nothing.
        cached: whether the compilation cache held what the first call needs.
        accuracy: errors by name.
        work: the least that an item needs; None where nobody can say.
    """

    name: str
    kind: Kind
    turns: tuple[float, ...]
    first: float | None = None
    cached: bool = False
    accuracy: dict[str, float] = field(default_factory=dict)
    work: Work | None = None

    @property
    def best(self) -> float:
        """Shortest turn [s an item]."""
        return min(self.turns)

    @property
    def median(self) -> float:
        """Median turn [s an item]."""
        return statistics.median(self.turns)

    @property
    def spread(self) -> float:
        """Distance of the quartiles over the median."""
        low, high = quartiles(self.turns)
        return (high - low) / self.median


@dataclass(frozen=True)
class Ratio:
    """A quotient of times, turn by turn: its median and its quartiles."""

    median: float
    low: float
    high: float


@dataclass(frozen=True)
class Group:
    """Contenders that did the same thing in turns.

    Attributes:
        title: what they did.
        item: what a time is of, such as "a QP".
        rows: of the contenders.
    """

    title: str
    item: str
    rows: tuple[Row, ...]

    def fastest_peer(self) -> Row | None:
        """The peer of the least median; None without peers."""
        return min((row for row in self.rows if row.kind == "peer"), key=lambda row: row.median, default=None)

    def lead(self, row: Row) -> Ratio | None:
        """The fastest peer's time over a row's of ours, above 1 where ours is faster; None where there is no peer."""
        peer = self.fastest_peer()
        return quotient(peer.turns, row.turns) if peer is not None and row.kind == "ours" else None


@dataclass(frozen=True)
class Fact:
    """A figure that is no time, such as a share or a count."""

    name: str
    value: float
    unit: str = ""


@dataclass(frozen=True)
class Result:
    """What one benchmark found.

    Attributes:
        groups, facts: its figures.
        missing: packages of the extra that were not installed, whose rows are left out.
        seconds: of the whole benchmark, compilation included.
        peak_memory: [bytes] of its process.
        others: cores that other processes kept busy meanwhile, on average; None where the system does not tell.
        failure: the last line of what stopped it; "" if nothing did.
    """

    groups: tuple[Group, ...] = ()
    facts: tuple[Fact, ...] = ()
    missing: tuple[str, ...] = ()
    seconds: float = 0.0
    peak_memory: float = 0.0
    others: float | None = None
    failure: str = ""


def quartiles(values: Iterable[float]) -> tuple[float, float]:
    """The lower and the upper quartile; of a single value, itself twice."""
    numbers = list(values)
    if len(numbers) < 2:
        return numbers[0], numbers[0]
    low, _, high = statistics.quantiles(numbers, n=4, method="inclusive")
    return low, high


def quotient(above: tuple[float, ...], below: tuple[float, ...]) -> Ratio:
    """Quotient turn by turn, so that what slowed a whole round cancels."""
    each = [a / b for a, b in zip(above, below, strict=True)]
    return Ratio(statistics.median(each), *quartiles(each))


def to_json(result: Result) -> dict[str, Any]:
    """A result as plain values, with best, median, spread and ratio spelt out for other readers."""
    plain = dataclasses.asdict(result)
    for group, written in zip(result.groups, plain["groups"], strict=True):
        peer = group.fastest_peer()
        for row, line in zip(group.rows, written["rows"], strict=True):
            line |= {"best": row.best, "median": row.median, "spread": row.spread}
            lead = group.lead(row)
            if lead is not None and peer is not None:
                line["peer_over_ours"] = {"peer": peer.name, **dataclasses.asdict(lead)}
    return plain


def from_json(value: Any) -> Result:
    """The result that `to_json` wrote.

    Raises:
        InputError: if it is no such thing, without a full stop; the caller says of which file.
    """
    try:
        groups = tuple(
            Group(group["title"], group["item"], tuple(_row(row) for row in group["rows"])) for group in value["groups"]
        )
        facts = tuple(Fact(fact["name"], _number(fact["value"]), fact["unit"]) for fact in value["facts"])
        others = None if value["others"] is None else _number(value["others"])
        seconds, memory = _number(value["seconds"]), _number(value["peak_memory"])
        return Result(groups, facts, tuple(value["missing"]), seconds, memory, others, value["failure"])
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(f"holds no result of a benchmark ({type(error).__name__}: {error})") from error


def _row(value: Any) -> Row:
    turns = tuple(_number(turn) for turn in value["turns"])
    if value["kind"] not in get_args(Kind) or not turns or min(turns) <= 0:
        raise InputError(f"has a row {value['name']!r} that is neither ours nor a peer's, or has no times")
    work = None if value["work"] is None else Work(**value["work"])
    accuracy = {name: _number(error) for name, error in value["accuracy"].items()}
    first = None if value["first"] is None else _number(value["first"])
    return Row(value["name"], value["kind"], turns, first, bool(value["cached"]), accuracy, work)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise InputError(f"has {value!r} in the place of a number")
    return float(value)
