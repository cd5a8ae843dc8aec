"""Runs benchmarks, each in a process of its own: its peak memory is its own, and what fails does not take the rest."""

import json
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.suite.figures import Result, from_json
from benchmarks.suite.machine import Neighbours, describe, versions
from benchmarks.suite.registry import ROOT, Benchmark
from benchmarks.suite.report import Report


def run_all(benchmarks: Sequence[Benchmark], quick: bool, arguments: Sequence[str], say: Callable) -> Report:
    """Run benchmarks one after the other.

    Args:
        benchmarks: to run.
        quick: on fewer and smaller problems.
        arguments: of the command, for the report.
        say: told what begins and what failed.
    """
    load = round(os.getloadavg()[0], 2)
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M")
    results = {}
    for number, benchmark in enumerate(benchmarks, start=1):
        say(f"\n{number}/{len(benchmarks)} {benchmark.name}: {benchmark.line()}")
        results[benchmark.name] = result = run_one(benchmark, quick)
        if result.failure:
            say(f"{benchmark.name} failed: {result.failure}")
    command = shlex.join(["python", "-m", "benchmarks", *arguments])
    return Report(command, date, "quick" if quick else "full", describe(), versions(), load, results)


def run_one(benchmark: Benchmark, quick: bool) -> Result:
    """One benchmark's figures, those before a failure too; its tables go where this process's output goes.

    Args:
        benchmark: to run.
        quick: on fewer and smaller problems.
    """
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    neighbours, failure = Neighbours(), ""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "figures.json"
        command = [sys.executable, "-m", benchmark.module, "--json", str(file), *["--quick"] * quick]
        sys.stdout.flush()
        try:
            done = subprocess.run(
                command,
                cwd=ROOT,
                env={**os.environ, "PYTHONPATH": path},
                stderr=subprocess.PIPE,
                text=True,
                timeout=benchmark.limit,
                check=False,
            )
            if done.returncode != 0:
                lines = [line for line in done.stderr.splitlines() if line.strip()] or [f"status {done.returncode}"]
                failure = lines[-1].strip().removeprefix("error: ")
        except subprocess.TimeoutExpired:
            failure = f"stopped after {benchmark.limit:g} s; the figures are those until then"
        found = from_json(json.loads(file.read_text(encoding="utf-8"))) if file.exists() else Result()
    return replace(found, others=neighbours.cores(), failure=failure)
