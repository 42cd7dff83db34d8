"""Seconds of the first frames of a process, with an empty kernel cache and with a filled one."""

from __future__ import annotations

import sys
import tempfile
import time

from . import harness
from .child import ask
from .task import Task


def measure(task: Task) -> dict[str, float]:
    """Seconds until the scene is loaded, of the first frames, in this process."""
    begin = time.perf_counter()
    renderer = task.renderer()
    loaded = time.perf_counter() - begin
    first, second, _, fourth = (renderer.frame(task.seed(frame))[1] for frame in range(4))
    return {
        "loading": loaded,
        "first frame": first,
        "second frame": second,
        "fourth frame": fourth,
    }


def cold_and_warm(task: Task) -> dict[str, float]:
    """First frame of a process with an empty kernel cache, and of the next one, which finds it."""
    with tempfile.TemporaryDirectory() as home:
        return {
            f"{name}, {cache} kernel cache": seconds
            for cache in ("cold", "warm")
            for name, seconds in ask("startup", task, home).items()
        }


if __name__ == "__main__":
    sys.exit(harness.main("startup", lambda name: "s", cold_and_warm))
