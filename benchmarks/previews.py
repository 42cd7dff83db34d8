"""Milliseconds of a still's frames, with a preview that is steered and without, in turns."""

from __future__ import annotations

import sys
import time

import drjit as dr
import numpy as np

from mitsuba_restir.still.goal import Goal
from mitsuba_restir.studies.runs.probing import SIGMA, stills_of

from . import harness
from .task import Task

WARM = 6
"""Frames that are not measured: the first are recorded, and weights change after the fourth."""

MEASURED = 10


def measure(task: Task) -> dict[str, float]:
    """Measure in this process; medians over the frames."""
    times: dict[str, list[float]] = {"plain frame": [], "frame with a preview": []}
    stills = stills_of(task.study, task.size, task.variant)
    grown = [
        stills.begun(task.seed(0), sigma).grow(Goal(frames=WARM + MEASURED))
        for sigma in (None, SIGMA)
    ]
    for frame in range(WARM + MEASURED):
        for name, frames in zip(times, grown, strict=True):
            begin = time.perf_counter()
            next(frames)
            dr.sync_thread()
            if frame >= WARM:
                times[name].append(1e3 * (time.perf_counter() - begin))
    plain, steered = (float(np.median(values)) for values in times.values())
    found = dict(zip(times, (plain, steered), strict=True))
    return {**found, "more, per cent": 100 * (steered / plain - 1)}


if __name__ == "__main__":
    sys.exit(harness.main("previews", lambda name: "%" if "cent" in name else "ms"))
