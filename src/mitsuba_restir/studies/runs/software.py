"""What renders the runs: the versions behind an image, so that runs of two are not mixed unseen."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib import metadata
from pathlib import Path

from ... import __version__, llvm
from .results import Run

# What the images come from: folders of this package.
_SOURCES = ("integrators", "passes", "paths", "resampling", "sampling", "shifts", "studies/runs")


@cache
def software() -> str:
    """Return the versions, and of this package a digest of the source that renders as well."""
    package = Path(__file__).parents[2]
    digest = hashlib.sha256()
    files = [file for folder in _SOURCES for file in (package / folder).rglob("*.py")]
    for file in sorted(files):
        digest.update(file.relative_to(package).as_posix().encode())
        digest.update(file.read_bytes())
    others = [f"{name} {metadata.version(name)}" for name in ("mitsuba", "drjit")]
    library = llvm.find().path
    compiler = "LLVM found by Dr.Jit" if library is None else library.name
    own = f"mitsuba-restir {__version__} ({digest.hexdigest()[:8]})"
    return ", ".join([own, *others, compiler])


def notes_on_software(size: str, runs: Iterable[Run]) -> list[str]:
    """Say where the runs of a size were not all rendered by the same software."""
    found = sorted({run.software or "an unknown version" for run in runs})
    if len(found) < 2:
        return []
    return [
        f"the runs at {size} were not all rendered by the same software ({'; '.join(found)}): "
        "what changed between the versions is in their differences"
    ]
