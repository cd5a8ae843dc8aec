"""Reports made up for the tests: two contenders whose times are known numbers."""

from benchmarks.suite.figures import Fact, Group, Result, Row, Work
from benchmarks.suite.report import Report

MACHINE = {"processor": "Abacus", "cores": 2, "memory": 4, "system": "Linux", "python": "3.11"}


def floor_result() -> Result:
    names = {"empty step of a loop": 1e-9, "matrix product": 1e-11, "sum of two arrays": 1e-10}
    rows = tuple(Row(name, "ours", (time, 2 * time, 3 * time)) for name, time in names.items())
    return Result((Group("floor", "each", rows),))


def report(ours=(1e-6, 2e-6, 3e-6), peer=(2e-6, 4e-6, 6e-6), load=0.1, others=0.0, date="2020-01-01 00:00") -> Report:
    """One group of a row of ours, whose task takes 1000 bytes, and a peer's."""
    rows = (
        Row("ours", "ours", ours, 1.5, accuracy={"worst gap": 1e-6}, work=Work(bytes=1000.0)),
        Row("other", "peer", peer),
    )
    group = Group("programs in a row", "a QP", rows)
    result = Result((group,), (Fact("converged", 99.0, "%"),), ("daqp",), 12.0, float(2**30), others)
    return Report(
        "python -m benchmarks qp",
        date,
        "quick",
        dict(MACHINE),
        {"jax": "1"},
        load,
        {"floor": floor_result(), "qp": result},
    )
