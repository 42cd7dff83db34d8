"""Finding an LLVM that works, before Dr.Jit looks for one itself.

Dr.Jit loads its LLVM library while ``import drjit`` runs and never again. LLVM 15 and 16, which
Linux distributions still ship, abort the process on the first render with Dr.Jit 1.5, so the
choice cannot be left to the system's search path.
"""

from __future__ import annotations

import functools
import importlib.metadata
import os
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

ENVIRONMENT_VARIABLE = "DRJIT_LIBLLVM_PATH"
WHEEL = "karellen-llvm-core"
OLDEST_USABLE = 19

_SYSTEM_PATTERNS = {
    "linux": (
        "/usr/lib/*/libLLVM*.so*",
        "/usr/lib64/libLLVM*.so*",
        "/usr/lib/libLLVM*.so*",
        "/usr/lib/llvm-*/lib/libLLVM*.so*",
        "/usr/lib64/llvm*/lib*/libLLVM*.so*",
    ),
    "darwin": (
        "/opt/homebrew/opt/llvm*/lib/libLLVM*.dylib",
        "/usr/local/opt/llvm*/lib/libLLVM*.dylib",
    ),
}


@dataclass(frozen=True)
class Llvm:
    """
    Where LLVM comes from.

    Fields
    ------
    path : Path or None
        The shared library; None leaves the search to Dr.Jit.
    source : str
        Who chose it: the user, the pip wheel, the system, or nobody.
    """

    path: Path | None
    source: str


def version_in(path: Path) -> int | None:
    """Major version that a library's file name (or that of what it links to) states, if any."""
    name = r"libLLVM(?:-|\.so\.|\.)(\d+)"
    for candidate in (path, path.resolve()):
        match = re.search(name, candidate.name) or re.search(
            r"/llvm[-@/](\d+)[./]", candidate.as_posix()
        )
        if match:
            return int(match[1])
    return None


def wheel_library() -> Path | None:
    """Return the shared library that the pip wheel installed, read from the wheel's own records."""
    try:
        files = importlib.metadata.files(WHEEL) or []
    except importlib.metadata.PackageNotFoundError:
        return None
    # The wheel's unversioned names are links made after installation; take the real file.
    for file in files:
        if re.fullmatch(r"libLLVM\.so\.[\d.]+", file.name):
            path = Path(os.path.normpath(str(file.locate())))
            if path.is_file():
                return path
    return None


def newest(candidates: Iterable[Path]) -> Path | None:
    """Return the library of the highest version >= 19 among the candidates, or None."""
    usable = [(version_in(path) or 0, str(path), path) for path in candidates]
    usable = [entry for entry in usable if entry[0] >= OLDEST_USABLE]
    return max(usable)[2] if usable else None


def system_library() -> Path | None:
    """Newest system LLVM >= 19 in the places where packages put it (Linux and macOS)."""
    root = Path("/")
    patterns = _SYSTEM_PATTERNS.get(sys.platform, ())
    return newest(path for pattern in patterns for path in root.glob(pattern.lstrip("/")))


def find(environment: Mapping[str, str] | None = None) -> Llvm:
    """
    Choose an LLVM: the user's, else the pip wheel's, else a system LLVM >= 19.

    Parameters
    ----------
    environment : mapping, optional
        Environment variables, by default the process's own.
    """
    environment = os.environ if environment is None else environment
    given = environment.get(ENVIRONMENT_VARIABLE)
    if given:
        return Llvm(Path(given), f"set by {ENVIRONMENT_VARIABLE}")
    if path := wheel_library():
        return Llvm(path, f"from the pip package {WHEEL}")
    if path := system_library():
        return Llvm(path, "the system's")
    return Llvm(None, "left to Dr.Jit's own search")


@functools.cache
def provide() -> Llvm:
    """Choose an LLVM once per process and point Dr.Jit, not yet loaded, and all children to it."""
    chosen = find()
    if chosen.path is not None:
        os.environ[ENVIRONMENT_VARIABLE] = str(chosen.path)
    return chosen


def too_late_message(loaded: tuple[int, ...], chosen: Llvm) -> str | None:
    """
    Say what to do where Dr.Jit was imported first and holds an unusable LLVM.

    Parameters
    ----------
    loaded : tuple of int
        ``drjit.detail.llvm_version()``; negative where none was found.
    chosen : Llvm
        What this package would have chosen.

    Returns
    -------
    str or None
        None where nothing is wrong or nothing better is known.
    """
    if loaded[0] >= OLDEST_USABLE or chosen.path is None:
        return None
    found = "no LLVM" if loaded[0] < 0 else f"LLVM {'.'.join(map(str, loaded))}"
    return (
        f"Mitsuba was imported first and loaded {found}, which does not work. Import "
        f"mitsuba_restir before mitsuba, or set {ENVIRONMENT_VARIABLE}={chosen.path}"
    )
