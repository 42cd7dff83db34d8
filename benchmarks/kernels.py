"""Kernels compiled, fetched from the disk's cache, and launched, per frame after warm-up."""

from __future__ import annotations

import sys

import drjit as dr

from . import harness
from .task import Task


def measure(task: Task) -> dict[str, float]:
    """Measure in this process."""
    renderer = task.renderer()
    task.render(renderer, 0, task.warmup)
    frames = task.study.frames
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        task.render(renderer, task.warmup, frames)
        history = dr.kernel_history([dr.KernelType.JIT])
    return {
        "kernels compiled per frame": sum(not k["cache_hit"] for k in history) / frames,
        "kernels read from disk per frame": sum(bool(k["cache_disk"]) for k in history) / frames,
        "kernels launched per frame": len(history) / frames,
    }


if __name__ == "__main__":
    sys.exit(harness.main("kernels"))
