"""Processes ended at random moments, by SIGKILL and SIGTERM in turn: nothing finished is lost.

``make test-long ARGS='tests/test_faults_killed.py -s'`` prints how many ended how.
"""

from __future__ import annotations

import csv
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir import imageio

pytestmark = pytest.mark.long

COMMAND = [sys.executable, "-m", "mitsuba_restir"]
ENDS = 20
FRAMES = 100_000
STUDY = """
name = "tiny"
scene = "ajar"
sizes = ["16x9"]
max_depth = 3
warmup = 2
frames = 4
runs = 120
quantities = ["rmse"]
baseline = "one"
[variants.one]
type = "restir_pt"
[variants.two]
type = "restir_pt"
mutations = 1
[reference]
spp = 64
batches = 8
"""


def ended(command: list[str], number: signal.Signals, seconds: float) -> int:
    """Run a command, end it after some seconds, and return its exit code."""
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            error = process.communicate(timeout=seconds)[1]
        except subprocess.TimeoutExpired:
            process.send_signal(number)
            try:
                error = process.communicate(timeout=60)[1]
            finally:
                process.kill()
    assert "Traceback" not in error, error
    assert process.returncode in (0, -number, 128 + number), error
    return process.returncode


def moments(seed: int, alone: list[str]) -> list[tuple[signal.Signals, float]]:
    """
    When each process is ended [s], and by what: from while it starts to while it renders.

    ``alone`` is the same command for as little as possible; its time is the unit.
    """
    start = time.monotonic()
    assert subprocess.run(alone, check=False, capture_output=True).returncode == 0
    unit = time.monotonic() - start
    times = unit * np.random.default_rng(seed).uniform(0.1, 2.0, ENDS)
    return [((signal.SIGKILL, signal.SIGTERM)[i % 2], t) for i, t in enumerate(times)]


def whole(path: Path) -> dict[Path, int]:
    """Finished runs and batches, and when they were finished."""
    files = [*(path / "killed").rglob("0*.npz"), *(path / "cache").rglob("0*.npz")]
    return {file: file.stat().st_mtime_ns for file in files}


def numbers(folder: Path) -> list[dict[str, str]]:
    """Rows of results but for the times."""
    with open(folder / "results.csv", newline="") as file:
        return [row for row in csv.DictReader(file) if "time" not in str(row)]


def test_a_study(tmp_path, monkeypatch):
    monkeypatch.setenv("MITSUBA_RESTIR_CACHE", str(tmp_path / "cache"))
    file, out = tmp_path / "tiny.toml", tmp_path / "killed"
    file.write_text(STUDY)
    command = [*COMMAND, "evaluate", str(file), "-o", str(out)]
    codes: Counter[int] = Counter()
    grown: list[int] = []
    finished: dict[Path, int] = {}
    alone = [*command[:-1], str(tmp_path / "alone"), "-s", "runs=1"]
    for number, seconds in moments(1, alone):
        codes[ended(command, number, seconds)] += 1
        now = whole(tmp_path)
        assert {path: now.get(path) for path in finished} == finished
        grown.append(len(now) - len(finished))
        finished = now
    print(f"\nevaluate: exit codes {dict(codes)}, new files after each {grown}")
    assert subprocess.run(command, check=False, capture_output=True).returncode == 0
    assert {path: whole(tmp_path).get(path) for path in finished} == finished
    assert not list(tmp_path.rglob(".*.partial"))
    command[-1] = str(tmp_path / "whole")
    assert subprocess.run(command, check=False, capture_output=True).returncode == 0
    assert numbers(out) == numbers(tmp_path / "whole")


def test_an_average(tmp_path):
    """After SIGTERM it is the mean of the first frames; after SIGKILL, what was there before."""
    picture = tmp_path / "mean.exr"
    command = [*COMMAND, "render", "ajar", "--resolution", "16x9", "-p", "max_depth=3"]
    average = [*command, "--average", "--frames", str(FRAMES), "-o", str(picture)]
    codes: Counter[int] = Counter()
    means: list[tuple[int, np.ndarray]] = []
    for number, seconds in moments(2, [*command, "-o", str(tmp_path / "alone.exr")]):
        before = picture.read_bytes() if picture.exists() else None
        code = ended(average, number, seconds)
        codes[code] += 1
        after = picture.read_bytes() if picture.exists() else None
        if code == -signal.SIGKILL:
            assert after == before
        elif after != before:
            count = int(mi.Bitmap(str(picture)).metadata()["frames averaged"])
            means.append((count, imageio.read_rgb(picture)))
    counts = [count for count, _ in means]
    print(f"\nrender --average: exit codes {dict(codes)}, frames in each average {counts}")
    assert counts

    start = time.monotonic()
    single = [*command, "--frames", str(max(counts)), "-o", str(tmp_path / "frame.exr")]
    assert subprocess.run(single, check=False, capture_output=True).returncode == 0
    total = np.zeros((9, 16, 3))
    sums = {}
    for frame in range(max(counts)):
        total = total + imageio.read_rgb(tmp_path / f"frame_{frame:04d}.exr")
        sums[frame + 1] = total
    print(f"{max(counts)} single frames in {time.monotonic() - start:.0f} s")
    for count, mean in means:
        np.testing.assert_array_equal(mean, (sums[count] / count).astype(np.float32))
