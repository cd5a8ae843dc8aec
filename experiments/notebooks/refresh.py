"""Run the notebooks again and write their outputs: python -m experiments.notebooks.refresh [NAME ...]."""

import argparse
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jupytext
import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

HERE = Path(__file__).resolve().parent
SCRIPTS = tuple(sorted(file for file in HERE.glob("*.py") if file.stem not in ("__init__", "refresh")))
"""The notebooks' sources."""

TIMEOUT = 900
"""[s] of a cell at most."""


def read_script(script: Path, parameters: Mapping[str, Any] | None = None) -> NotebookNode:
    """A notebook without outputs from its script.

    Args:
        script: in jupytext's percent format.
        parameters: assigned after the cell with the tag `parameters`, as papermill does.

    Raises:
        ValueError: for a parameter that this cell does not set.
    """
    notebook = jupytext.read(script)
    for number, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{number:02d}"
    if parameters:
        place = next(k for k, cell in enumerate(notebook.cells) if "parameters" in cell.metadata.get("tags", ()))
        unknown = [name for name in parameters if f"\n{name} = " not in f"\n{notebook.cells[place].source}"]
        if unknown:
            raise ValueError(f"{script.name} has no parameters {', '.join(unknown)}.")
        lines = "\n".join(f"{name} = {value!r}" for name, value in parameters.items())
        notebook.cells.insert(place + 1, nbformat.v4.new_code_cell(lines, id="cell-parameters"))
    return notebook


def run(notebook: NotebookNode, folder: Path, environment: dict[str, str] | None = None) -> NotebookNode:
    """Execute a notebook in a kernel of its own, in place; raises where a cell does.

    Args:
        notebook: to execute.
        folder: that the kernel works in.
        environment: of the kernel; this process' own by default.
    """
    options = {} if environment is None else {"env": environment}
    client = NotebookClient(
        notebook,
        timeout=TIMEOUT,
        kernel_name="python3",
        coalesce_streams=True,
        extra_arguments=["--log-level=ERROR"],
        resources={"metadata": {"path": str(folder)}},
    )
    client.execute(**options)
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    notebook.metadata.pop("language_info", None)
    return notebook


def noise(notebook: NotebookNode) -> list[str]:
    """What cells wrote to the error stream: warnings that no reader should see."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    return [output.text for output in outputs if output.output_type == "stream" and output.name == "stderr"]


def main() -> int:
    """Run the named notebooks, or all; returns the exit status."""
    names = [script.stem for script in SCRIPTS]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of notebooks: {', '.join(names)}; all by default")
    wanted = parser.parse_args().names or names
    unknown = [name for name in wanted if name not in names]
    if unknown:
        parser.error(f"no notebook {', '.join(unknown)}; choose from {', '.join(names)}")
    for name in wanted:
        began = time.perf_counter()
        notebook = run(read_script(HERE / f"{name}.py"), HERE)
        for words in noise(notebook):
            print(f"{name} wrote to the error stream: {words}")
        file = HERE / f"{name}.ipynb"
        nbformat.write(notebook, file)
        seconds, size = time.perf_counter() - began, file.stat().st_size / 1000
        print(f"{name}: {seconds:.0f} s, {size:.0f} kB", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
