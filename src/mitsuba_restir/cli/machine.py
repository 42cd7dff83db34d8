"""What this machine has for rendering: cores, memory, and programs that some commands want."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import shutil
import sys
from dataclasses import dataclass

SIZE = (1280, 720)
"""The frame [pixels] of which `doctor` says what it takes."""

BYTES_A_PIXEL = 366
"""Slope of Dr.Jit's peak over the pixels, by ``python -m benchmarks.memory decorrelation_memory``
(without mutations, which take it to 501)."""

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


@dataclass(frozen=True)
class Extra:
    """
    Something that is not needed to render, and what wants it.

    Fields
    ------
    name, wanted_by : str
    there : bool
    remedy : str
        The command, or where to get it.
    """

    name: str
    wanted_by: str
    there: bool
    remedy: str


def _module(name: str) -> bool:
    return importlib.util.find_spec(name) is not None


def _pip(extra: str) -> str:
    return f"pip install 'mitsuba-restir[{extra}]'"


def browser() -> str | None:
    """Path of a Chromium: the one that MITSUBA_RESTIR_CHROMIUM names, or one that is found."""
    named = os.environ.get("MITSUBA_RESTIR_CHROMIUM")
    return named or next(filter(None, map(shutil.which, _BROWSERS)), None)


def extras() -> list[Extra]:
    """Say of each optional program and package whether it is there."""
    chromium = browser() is not None
    report = all(map(_module, ("matplotlib", "pandas")))
    tev = shutil.which("tev") is not None
    tev_place = "https://github.com/Tom94/tev"
    return [
        Extra("OIDN", "--denoise", _module("mitsuba_oidn"), _pip("denoise")),
        Extra("FLIP", "evaluate", _module("flip_evaluator"), _pip("flip")),
        Extra("matplotlib, pandas", "figures of studies", report, _pip("report")),
        Extra("tev", "still --tev, where it runs here", tev, tev_place),
        Extra("tevclient", "still --tev", _module("tevclient"), _pip("tev")),
        Extra("Chromium", "tests of pages", chromium, "your system's packages"),
        Extra("nicegui", "the viewer", _module("nicegui"), _pip("view")),
        Extra("av", "videos", _module("av"), _pip("video")),
    ]


def cores() -> int:
    """How many processors this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # on macOS and Windows
        return os.cpu_count() or 1


def memory() -> int | None:
    """Bytes of main memory; None where the system does not say."""
    if sys.platform == "win32":
        return _windows_memory()
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError):
        return None


def frame_seconds(seconds: float, size: tuple[int, int]) -> float:
    """
    Estimate the time of a frame of `SIZE` from that of a smaller one: it grows as the pixels do.

    Parameters
    ----------
    seconds : float
        Time of a frame of ``size`` pixels.
    """
    return seconds * (SIZE[0] * SIZE[1]) / (size[0] * size[1])


def frame_bytes() -> int:
    """Memory that a frame of `SIZE` takes at its peak, beside the scene."""
    return BYTES_A_PIXEL * SIZE[0] * SIZE[1]


def _windows_memory() -> int | None:
    class Status(ctypes.Structure):
        _fields_ = (
            ("length", ctypes.c_ulong),
            ("load", ctypes.c_ulong),
            *((name, ctypes.c_ulonglong) for name in ("total", "free", "a", "b", "c", "d", "e")),
        )

    status = Status(length=ctypes.sizeof(Status))
    kernel = getattr(ctypes, "windll").kernel32  # noqa: B009  # unknown to mypy elsewhere
    return status.total if kernel.GlobalMemoryStatusEx(ctypes.byref(status)) else None
