"""``mitsuba-restir doctor``: is this installation able to render, and if not, what mends it."""

from __future__ import annotations

import argparse
import ctypes.util
import importlib.metadata
import platform
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import llvm
from . import machine
from .probe import FRAME, RENDERED, STEPS, Probe, probe


@dataclass(frozen=True)
class Diagnosis:
    """What is wrong, in one sentence, and the one command that mends it."""

    reason: str
    command: str


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "doctor",
        help="check the installation and say what mends it",
        description="Say which LLVM, variants and versions are in use, render a 16x16 probe, and "
        "say what the machine has and what a frame takes.",
    )
    parser.set_defaults(run=run)


def install_llvm_command(system: str = sys.platform, machine: str = platform.machine()) -> str:
    """Return the command that installs an LLVM which works on this platform."""
    if system == "linux" and machine == "x86_64":
        return f"{sys.executable} -m pip install --force-reinstall {llvm.WHEEL}"
    if system == "linux":
        return "sudo apt-get install libllvm19"
    if system == "darwin":
        return "brew install llvm"
    return "winget install LLVM.LLVM"


def diagnose(chosen: llvm.Llvm, result: Probe) -> Diagnosis | None:
    """
    Explain a failed probe of an LLVM variant.

    Parameters
    ----------
    chosen : Llvm
        The LLVM that Dr.Jit was pointed to.
    result : Probe
        What happened with it.

    Returns
    -------
    Diagnosis or None
        None where the probe succeeded.
    """
    if result.error is None:
        return None
    unset = "Remove-Item Env:" if sys.platform == "win32" else "unset "
    by_user = llvm.ENVIRONMENT_VARIABLE in chosen.source
    version = result.llvm_version
    if by_user and (version is None or "path" not in result.seconds):
        path = chosen.path
        what = (
            f"is not an LLVM library that can be loaded ({path})"
            if version is None
            else f"points to LLVM {version} ({path}), which does not work with Dr.Jit 1.5"
        )
        if path is not None and not path.exists():
            what = f"points to {path}, which does not exist"
        return Diagnosis(
            f"{llvm.ENVIRONMENT_VARIABLE} {what}", f"{unset}{llvm.ENVIRONMENT_VARIABLE}"
        )
    if version is None:
        return Diagnosis("no LLVM library was found or could be loaded", install_llvm_command())
    if "path" not in result.seconds:
        return Diagnosis(
            f"LLVM {version} ({chosen.source}) does not work with Dr.Jit 1.5; "
            f"version {llvm.OLDEST_USABLE} or newer does",
            install_llvm_command(),
        )
    pip = f"{sys.executable} -m pip install --force-reinstall mitsuba-restir"
    return Diagnosis("Mitsuba renders, but the restir_pt integrator does not", pip)


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def _has_nvidia_driver() -> bool:
    name = "nvcuda" if sys.platform == "win32" else "cuda"
    return ctypes.util.find_library(name) is not None or Path("/dev/nvidiactl").exists()


def _line(label: str, text: str) -> None:
    print(f"{label:<10}{text}", flush=True)


def _describe(result: Probe) -> str:
    done = [f"{step} {result.seconds[step]:.1f} s" for step in RENDERED if step in result.seconds]
    if result.error is None:
        return f"{result.variant}: 16x16 pixels, {', '.join(done)}"
    failed = next((step for step in STEPS if step not in result.seconds), STEPS[-1])
    return f"{result.variant}: FAILED at {failed}: {result.error}"


def _machine() -> str:
    total = machine.memory()
    memory = "memory unknown" if total is None else f"{total / 2**30:.1f} GiB of memory"
    return f"{machine.cores()} cores, {memory}"


def _frame(result: Probe) -> str:
    """What a frame takes, as far as the probe came."""
    size = "x".join(map(str, machine.SIZE))
    memory = f"{machine.frame_bytes() / 2**30:.2f} GiB beside the scene"
    if "frame" not in result.seconds:
        return f"{size}: {memory}"
    small = result.seconds["frame"]
    seconds = machine.frame_seconds(small, FRAME)
    return (
        f"{size}: about {seconds:.2g} s, {memory} (one of {'x'.join(map(str, FRAME))} of the "
        f"scene ajar took {1000 * small:.0f} ms with {result.variant})"
    )


def _extras() -> None:
    for extra in machine.extras():
        there = "yes" if extra.there else f"no: {extra.remedy}"
        _line("optional", f"{extra.name} ({extra.wanted_by}): {there}")


def run(_: argparse.Namespace) -> int:
    """Print the report; 0 where the installation can render, else 1."""
    import mitsuba as mi

    chosen = llvm.provide()
    packages = ("mitsuba-restir", "mitsuba", "drjit", "numpy", "mitsuba-oidn")
    _line("versions", ", ".join(f"{name} {_version(name)}" for name in packages))
    _line("python", f"{platform.python_version()} ({sys.executable}) on {platform.platform()}")
    _line("LLVM", f"{chosen.path or '(none)'}, {chosen.source}")
    _line("machine", _machine())
    _line("variants", ", ".join(mi.variants()))
    result = probe("llvm_ad_rgb")
    _line("loaded", f"LLVM {result.llvm_version}" if result.llvm_version else "no LLVM")
    _line("probe", _describe(result))
    cuda = probe("cuda_ad_rgb") if _has_nvidia_driver() else None
    _line("probe", _describe(cuda) if cuda else "cuda_ad_rgb: no NVIDIA driver, not tried")
    _line("frame", _frame(result if cuda is None or cuda.error else cuda))
    _extras()

    diagnosis = diagnose(chosen, result)
    if diagnosis is None:
        print("Ready.")
        return 0
    if cuda is not None and cuda.error is None:
        print(f"Ready for the cuda variants only: {diagnosis.reason}.")
    else:
        print(f"Not ready: {diagnosis.reason}.")
    print(f"To mend it: {diagnosis.command}")
    return 1
