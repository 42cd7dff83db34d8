"""Where a result was computed: machine and versions, kept beside the numbers."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path

from ... import __version__, llvm

_PACKAGES = ("mitsuba", "drjit", "numpy", "scipy", "mitsuba-oidn", "flip-evaluator", llvm.WHEEL)


def environment() -> dict[str, str | int]:
    """Return machine and versions by name; what is not installed is left out."""
    library = llvm.find().path
    found: dict[str, str | int] = {
        "processor": _processor(),
        "cores": _cores(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "mitsuba-restir": __version__,
        "LLVM": "found by Dr.Jit" if library is None else library.name,
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
