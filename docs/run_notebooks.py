"""Run the notebooks of the site, and keep what their cells print and draw.

    python docs/run_notebooks.py [NAME ...]    # writes docs/figures/NAME-CELL.png and .txt

CELL is a cell's ``:name:``, or its number. The page of a notebook shows what is kept here.
"""

from __future__ import annotations

import base64
import sys
import time
from pathlib import Path
from typing import Any

import jupytext
import nbclient

HERE = Path(__file__).resolve().parent
NOTEBOOKS = sorted((HERE / "notebooks").glob("*.md"))
FIGURES = HERE / "figures"


def executed(path: Path) -> Any:
    """
    Run a notebook in a kernel of its own.

    Raises
    ------
    nbclient.exceptions.CellExecutionError
        A cell failed.
    """
    notebook = jupytext.read(path)
    client = nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3")
    return client.execute(cwd=str(path.parent))


def outputs(notebook: Any) -> dict[str, tuple[str, bytes | None]]:
    """What each cell prints, and the picture that it draws, by the cell's name."""
    found = {}
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for number, cell in enumerate(code):
        printed, drawn = [], None
        for output in cell.outputs:
            if output.output_type == "stream" and output.name == "stdout":
                printed.append(output.text)
            elif picture := output.get("data", {}).get("image/png"):
                drawn = base64.b64decode(picture)
        found[str(cell.metadata.get("name", number))] = ("".join(printed), drawn)
    return found


def keep(stem: str, found: dict[str, tuple[str, bytes | None]]) -> None:
    """Write the outputs of a notebook, and remove what an earlier version of it left."""
    for old in (*FIGURES.glob(f"{stem}-*.png"), *FIGURES.glob(f"{stem}-*.txt")):
        old.unlink()
    for name, (printed, drawn) in found.items():
        if printed:
            (FIGURES / f"{stem}-{name}.txt").write_text(printed, "utf-8")
        if drawn:
            (FIGURES / f"{stem}-{name}.png").write_bytes(drawn)


def main(names: list[str]) -> None:
    """Run those that are named, or all."""
    for path in NOTEBOOKS:
        if not names or path.stem in names:
            start = time.perf_counter()
            keep(path.stem, outputs(executed(path)))
            print(f"{path.stem}: {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1:])
