"""Values that no option of a kind may take."""

import dataclasses
from collections.abc import Iterator
from typing import Any

LONG = "9" * 400
NO_NUMBERS = ("", "x", "1,5", "0x10", "--", "1e", "ten", "\u0661\u0662x", "[1]", "None5")
NOT_FINITE = ("nan", "inf", "-inf", "1e999", "-1e999")

COUNTS = ("-1", "1000000000", LONG, "-" + LONG, "9" * 5000, "nan", "inf", "1.5", "1e3", *NO_NUMBERS)
"""Of things to make; 0 is fine for some."""
SEEDS = ("-1", "1e30", LONG, "9" * 5000, "-" + LONG, "nan", "0.5", *NO_NUMBERS)
SECONDS = ("-1", "0", "1e30", "1e400", LONG, *NOT_FINITE, *NO_NUMBERS)
NAMES = ("", "unknown", "DEFAULT", "default ", "../x", "a\0b", "\x1b[2J", "x" * 3000, "classical;ls")
SWITCHES = ("True=1", "maybe", "2")

_LARGEST = 10.0**30


def leaves(settings: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """(option, default) of every single setting in dataclasses within dataclasses, as the commands name them."""
    for field in dataclasses.fields(settings):
        value, name = getattr(settings, field.name), prefix + field.name.replace("_", "-")
        if dataclasses.is_dataclass(value):
            yield from leaves(value, f"{name}.")
        else:
            yield f"--{name}", value


def impossible_values(default: Any) -> tuple[str, ...]:
    """What a setting with this default cannot be, whatever it means."""
    if isinstance(default, bool):
        return SWITCHES
    if isinstance(default, int):
        return ("-1000000", LONG, "-" + LONG, "1.5", "nan", *NO_NUMBERS)
    if isinstance(default, float):
        return ("-1e30", "1e300", LONG, *NOT_FINITE, *NO_NUMBERS)
    return NAMES
