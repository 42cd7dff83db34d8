"""Nanoseconds a pixel that each kernel of a frame takes, in the order of their launch.

With the defaults of ``restir_pt`` and a history, these are primary hits, candidates, temporal
reuse, the shifts of all neighbours, the merge, and the film; the rest is small.
"""

from __future__ import annotations

import sys

import drjit as dr
import numpy as np

from . import harness
from .task import Task


def measure(task: Task) -> dict[str, float]:
    """Measure in this process; the median over the frames."""
    renderer = task.renderer()
    task.render(renderer, 0, task.warmup)
    times = []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for frame in range(task.study.frames):
            dr.kernel_history_clear()
            task.render(renderer, task.warmup + frame, 1)
            dr.sync_thread()
            launched = dr.kernel_history([dr.KernelType.JIT])
            times.append([kernel["execution_time"] for kernel in launched])
    least = min(len(frame) for frame in times)
    kernels = np.median([frame[:least] for frame in times], axis=0) * 1e6 / task.pixels
    numbers = {f"kernel {i}": float(time) for i, time in enumerate(kernels, 1)}
    return {**numbers, "all kernels": float(kernels.sum())}


if __name__ == "__main__":
    sys.exit(harness.main("passes", lambda name: "ns/pixel"))
