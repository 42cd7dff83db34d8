"""Bytes: of the state kept between frames per pixel, and at the peak of a frame.

The peak per pixel is the slope over sizes, which leaves out what does not grow with the image, such
as scene and kernels. Dr.Jit rounds every array to a power of two, so that sizes which are none
measure the rounding as well.
"""

from __future__ import annotations

import contextlib
import dataclasses
import re
import sys
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from . import harness
from .task import Task


def measure(task: Task) -> dict[str, float]:
    """Measure in this process."""
    renderer = task.renderer()
    task.render(renderer, 0, task.warmup)
    dr.detail.malloc_clear_statistics()
    _forget_resident_peak()
    task.render(renderer, task.warmup, task.study.frames)
    found = {"peak": float(dr.detail.malloc_watermark(dr.backend_v(mi.Float))), **_resident()}
    if renderer.history is not None:
        history = renderer.history()
        found["reservoir"] = _bytes(history.reservoirs) / task.pixels
        found["path record"] = _bytes(history.reservoirs.path) / task.pixels
        learnt = _bytes(history.learnt)
        found["reservoir and primary hit"] = (_bytes(history) - learnt) / task.pixels
        if learnt:
            found["guide"] = float(learnt)
    return found


def _forget_resident_peak() -> None:
    """Start the resident peak anew, so that loading the scene is not part of it (Linux)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _resident() -> dict[str, float]:
    """Peak of the resident memory in bytes; nothing where the system does not tell (not Linux)."""
    try:
        status = Path("/proc/self/status").read_text("utf-8")
    except OSError:
        return {}
    found = re.search(r"VmHWM:\s*(\d+) kB", status)
    return {"peak resident": float(found[1]) * 1024.0} if found else {}


def _bytes(value: Any) -> int:
    """Bytes of all arrays of a (nested) structure."""
    if dataclasses.is_dataclass(value):
        return sum(_bytes(getattr(value, field.name)) for field in dataclasses.fields(value))
    if isinstance(value, list | tuple):
        return sum(_bytes(entry) for entry in value)
    if not dr.is_array_v(value):
        return 0
    if dr.depth_v(value) > 1:
        return sum(_bytes(value[i]) for i in range(len(value)))
    return int(dr.width(value) * dr.itemsize_v(value))


def slopes(answers: harness.Answers) -> dict[str, list[float]]:
    """Peak bytes per pixel of every run: slope of a straight line through the sizes."""
    if len(answers) < 2:
        return {}
    pixels = np.array([width * height for width, height in answers], dtype=np.float64)
    found = {}
    for name, label in (
        ("peak", "slope of the peak, Dr.Jit's memory"),
        ("peak resident", "slope of the peak, resident memory"),
    ):
        runs = zip(*answers.values(), strict=True)
        peaks = np.array([[answer.get(name, np.nan) for answer in run] for run in runs])
        if np.isfinite(peaks).all():
            found[label] = np.polyfit(pixels, peaks.T, 1)[0].tolist()
    return found


def unit_of(name: str) -> str:
    """Return the unit of a number."""
    return "B" if name.startswith(("peak", "guide")) else "B/pixel"


if __name__ == "__main__":
    sys.exit(harness.main("memory", unit_of, across=slopes))
