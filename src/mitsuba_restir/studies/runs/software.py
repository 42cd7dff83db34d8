"""Where results come from: machine and versions, so that runs of two are not mixed unseen."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterable
from functools import cache
from importlib import metadata
from pathlib import Path

from ... import __version__, llvm
from .results import Run

_PACKAGES = ("mitsuba", "drjit", "numpy", "scipy", "mitsuba-oidn", "flip-evaluator", llvm.WHEEL)

# What the images come from: folders of this package.
_SOURCES = ("integrators", "passes", "paths", "resampling", "sampling", "shifts", "studies/runs")


@cache
def software() -> str:
    """Return the versions, and of this package a digest of the source that renders as well."""
    package = Path(__file__).parents[2]
    digest = hashlib.sha256()
    for file in sorted(file for folder in _SOURCES for file in (package / folder).rglob("*.py")):
        digest.update(file.relative_to(package).as_posix().encode())
        digest.update(file.read_bytes())
    own = f"mitsuba-restir {__version__} ({digest.hexdigest()[:8]})"
    others = [f"{name} {metadata.version(name)}" for name in ("mitsuba", "drjit")]
    return ", ".join([own, *others, f"LLVM {_llvm()}"])


def notes_on_software(size: str, runs: Iterable[Run]) -> list[str]:
    """Say where the runs of a size were not all rendered by the same software."""
    found = sorted({run.software or "an unknown version" for run in runs})
    if len(found) < 2:
        return []
    return [
        f"the runs at {size} were not all rendered by the same software ({'; '.join(found)}): "
        "what changed between the versions is in their differences"
    ]


def environment() -> dict[str, str | int]:
    """Return machine and versions by name; what is not installed is left out."""
    found: dict[str, str | int] = {
        "processor": _processor(),
        "cores": _cores(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "mitsuba-restir": __version__,
        "LLVM": _llvm(),
    }
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def _processor() -> str:
    """Name of the processor; `platform` knows only its architecture on Linux."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _cores() -> int:
    """Cores that this process may use, which containers restrict."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _llvm() -> str:
    library = llvm.find().path
    return "found by Dr.Jit" if library is None else library.name
