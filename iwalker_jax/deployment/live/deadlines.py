"""How punctual a loop was: latencies, jitter and missed deadlines."""

from typing import NamedTuple

import numpy as np


class Punctuality(NamedTuple):
    """Figures of a loop.

    Attributes:
        name: of the loop; rate: [Hz] that is wanted.
        due: times that it was to answer.
        missed: of them later than a period, or not at all.
        median, most, longest: [s] latency: half of them, 99 % of them, and all took at most this.
        jitter: [s] standard deviation of the time between two answers.
    """

    name: str
    rate: float
    due: int
    missed: int
    median: float
    most: float
    longest: float
    jitter: float

    def sentence(self) -> str:
        """All of it in a sentence."""
        share = 100 * self.missed / max(self.due, 1)
        return (
            f"{self.name}, {self.rate:.0f} Hz: {self.missed} of {self.due} deadlines missed ({share:.3f} %); latency "
            f"{1e3 * self.median:.2f} ms, 99 % within {1e3 * self.most:.2f} ms, longest {1e3 * self.longest:.1f} ms; "
            f"jitter {1e3 * self.jitter:.2f} ms."
        )


class Deadlines:
    """Counts a loop's answers."""

    def __init__(self, name: str, rate: float) -> None:
        """Begin to count a loop of a name and a rate [Hz]."""
        self.name, self.rate, self.skipped = name, rate, 0
        self._latencies: list[float] = []
        self._answers: list[float] = []

    def answered(self, asked: float, answered: float) -> None:
        """One answer, with the times [s] of the question and of the answer."""
        self._latencies.append(answered - asked)
        self._answers.append(answered)

    def skip(self, count: int) -> None:
        """Questions that found no answer, because a newer one was there already."""
        self.skipped += count

    def punctuality(self) -> Punctuality:
        """The figures so far."""
        latencies = np.asarray(self._latencies or [0.0])
        intervals = np.diff(self._answers) if len(self._answers) > 1 else np.zeros(1)
        return Punctuality(
            name=self.name,
            rate=self.rate,
            due=len(self._latencies) + self.skipped,
            missed=int(np.sum(latencies > 1 / self.rate)) + self.skipped,
            median=float(np.median(latencies)),
            most=float(np.percentile(latencies, 99)),
            longest=float(latencies.max()),
            jitter=float(np.std(intervals)),
        )
