"""What a sentence is that answers a malformed input."""

from collections.abc import Callable

from iwalker_jax.errors import CheckpointError, InputError


def is_no_sentence(text: str, most: int = 1200) -> str | None:
    """What keeps a text from being one printable sentence; None if nothing does."""
    if not text.strip():
        return "says nothing"
    if "Traceback" in text or "\n" in text.strip() or not text.strip().isprintable() or len(text) > most:
        return f"says {text[:300]!r}"
    return None


def refused(what: str, call: Callable[[], object]) -> str | None:
    """What is wrong with how a call was answered that had to be refused; None if nothing is."""
    try:
        call()
    except (InputError, CheckpointError) as error:
        wrong = is_no_sentence(str(error))
        return wrong and f"{what}: {wrong}"
    except Exception as error:
        raise RuntimeError(f"{what}: {type(error).__name__}: {error}") from error
    return f"{what}: accepted"
