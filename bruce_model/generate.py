"""Write bruce.xml next to this file: `python -m bruce_model.generate`; with `--check`, only compare."""

import argparse
import sys

from bruce_model import BRUCE_XML, mjcf_text
from iwalker_jax.runtime.files import write_text


def main(arguments: list[str] | None = None) -> int:
    """Write the model with default options, or compare the file with it; the result is the exit status."""
    parser = argparse.ArgumentParser(prog="python -m bruce_model.generate", description=__doc__)
    parser.add_argument("--check", action="store_true", help="do not write; exit 1 if the file is not up to date")
    check = parser.parse_args(arguments).check
    text = mjcf_text()
    if check:
        if BRUCE_XML.is_file() and BRUCE_XML.read_text(encoding="utf-8") == text:
            return 0
        print(f"{BRUCE_XML.name} is not up to date; run `python -m bruce_model.generate`.", file=sys.stderr)
        return 1
    write_text(BRUCE_XML, text)
    print(f"wrote {BRUCE_XML}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
