"""All kinds by family, and which case comes when."""

from collections.abc import Callable, Iterator

from tests.malformed import command_options, front_door, front_door_settings, recordings, saved_files, scene_files
from tests.malformed.kinds import Kind

FAMILIES: dict[str, dict[str, Kind]] = {
    "recordings": recordings.KINDS,
    "commands": command_options.KINDS,
    "files": saved_files.KINDS,
    "library": front_door.KINDS | front_door_settings.KINDS,
    "scenes": scene_files.KINDS,
}

WEIGHTS = {"recordings": 1, "commands": 1, "files": 1, "library": 1, "scenes": 1}
"""Cases of a family in every round."""

PREPARED: dict[str, Callable[[], object]] = {
    "files": saved_files.prepare,
    "library": front_door.prepare,
    "scenes": scene_files.prepare,
}
"""What a family makes before its first case, which a case's time is not to hold."""


def schedule(count: int, only: str | None = None) -> Iterator[tuple[str, Kind, int]]:
    """(name, kind, number) of so many cases; a family's cases are numbered by themselves, its kinds in turn.

    So a case stays the same by its kind, seed and number when another family grows.
    """
    if only in FAMILIES:
        turns = [only]
    elif only is None:
        turns = [family for family, weight in WEIGHTS.items() for _ in range(weight)]
    else:
        yield from _of_one_kind(count, only)
        return
    for family in dict.fromkeys(turns):
        PREPARED.get(family, object)()
    numbers = dict.fromkeys(FAMILIES, 0)
    for turn in range(count):
        family = turns[turn % len(turns)]
        number, kinds = numbers[family], list(FAMILIES[family].items())
        numbers[family] += 1
        name, kind = kinds[number % len(kinds)]
        yield name, kind, number


def _of_one_kind(count: int, name: str) -> Iterator[tuple[str, Kind, int]]:
    for family, kinds in FAMILIES.items():
        if name in kinds:
            PREPARED.get(family, object)()
            first = list(kinds).index(name)
            for turn in range(count):
                yield name, kinds[name], first + turn * len(kinds)
            return
    raise SystemExit(f"error: unknown kind {name!r}; choose a family of {', '.join(FAMILIES)} or one of its kinds.")
