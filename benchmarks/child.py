"""A process that measures once: ``python -m benchmarks.child NAME STUDY.toml SIZE VARIANT RUN``.

It sees a fresh allocator and, where its home directory is a new one, an empty kernel cache. The
answer is one line of JSON.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path

from mitsuba_restir.errors import RenderError, one_line
from mitsuba_restir.studies import load_study
from mitsuba_restir.studies.config.files import dump_study

from .task import Task


def ask(benchmark: str, task: Task, home: str = "") -> dict[str, float]:
    """
    Measure in a fresh process, with a home directory of its own where one is given.

    Raises
    ------
    RenderError
        It failed; says why.
    """
    environment = dict(os.environ)
    here = str(Path(__file__).parents[1])
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [here, environment.get("PYTHONPATH")]))
    if home:
        # Dr.Jit keeps compiled kernels below the home directory.
        environment["HOME"] = environment["LOCALAPPDATA"] = home
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / "study.toml"
        study.write_bytes(dump_study(task.study))
        size = f"{task.size[0]}x{task.size[1]}"
        request = [benchmark, str(study), size, task.variant, str(task.index)]
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.child", *request],
            capture_output=True,
            text=True,
            env=environment,
            check=False,
        )
    lines = done.stdout.strip().splitlines()
    if done.returncode or not lines:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise RenderError(
            f"{task.study.name}: benchmark '{benchmark}' of '{task.variant}' failed: "
            f"{one_line(last)}"
        )
    answer: dict[str, float] = json.loads(lines[-1])
    return answer


def main(benchmark: str, file: str, size: str, variant: str, index: str) -> None:
    """Answer a request."""
    width, height = size.split("x")
    task = Task(load_study(file), (int(width), int(height)), variant, int(index))
    print(json.dumps(import_module(f"benchmarks.{benchmark}").measure(task)))


if __name__ == "__main__":
    main(*sys.argv[1:])
