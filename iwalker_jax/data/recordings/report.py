"""What a validator found in a recording: usable frames, problems file by file, and what had to be assumed."""

from dataclasses import dataclass
from pathlib import Path

from iwalker_jax.perception import Intrinsics


@dataclass(frozen=True)
class FileProblem:
    """One thing that is wrong with one file.

    Attributes:
        file: path relative to the recording's folder.
        problem: what is wrong and, where it helps, what to do.
    """

    file: str
    problem: str


@dataclass(frozen=True)
class RecordedTopic:
    """One topic of a bag.

    Attributes:
        name: of the topic.
        type: of its messages.
        messages: their number.
        use: what it is read for and why it was chosen, or why it is not read.
    """

    name: str
    type: str
    messages: int
    use: str = ""


@dataclass(frozen=True)
class RecordingReport:
    """Findings about one recording.

    Attributes:
        folder: or bag that was read.
        layout: "yaml", "tum", "iplanner" or "bag"; "unknown" if none was recognised.
        found: number of depth images listed or present.
        usable: files of the frames that can be used, in order.
        problems: what is wrong, file by file; the frames concerned are left out.
        assumptions: what the folder did not say.
        fatal: sentence that says why nothing can be used; None if the recording is usable.
        intrinsics: of the recorded images, if known.
        depth_scale: [m] per unit of the images, if known.
        mount: median [height m, pitch rad, roll rad, forward m, left m], if frames are usable.
        topics: of a bag, with what each is read for.
    """

    folder: Path
    layout: str
    found: int = 0
    usable: tuple[str, ...] = ()
    problems: tuple[FileProblem, ...] = ()
    assumptions: tuple[str, ...] = ()
    fatal: str | None = None
    intrinsics: Intrinsics | None = None
    depth_scale: float | None = None
    mount: tuple[float, ...] | None = None
    topics: tuple[RecordedTopic, ...] = ()

    @property
    def is_usable(self) -> bool:
        """Whether at least one frame can be used."""
        return self.fatal is None and len(self.usable) > 0
