"""What a sentence is that answers a malformed input."""


def is_no_sentence(text: str, most: int = 1200) -> str | None:
    """What keeps a text from being one printable sentence; None if nothing does."""
    if not text.strip():
        return "says nothing"
    if "Traceback" in text or "\n" in text.strip() or not text.strip().isprintable() or len(text) > most:
        return f"says {text[:300]!r}"
    return None
