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
from dataclasses import dataclass
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir import imageio

pytestmark = pytest.mark.long

COMMAND = [sys.executable, "-m", "mitsuba_restir"]
ENDS = 20
STUDY = """
name = "tiny"
scene = "ajar"
sizes = ["16x9"]
max_depth = 3
warmup = 2
frames = 4
runs = 100
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


BEGUN = "begun"
MARKING = """
import sys
from pathlib import Path
from mitsuba_restir import cli
from mitsuba_restir.cli.writer import Writer
from mitsuba_restir.studies.store.folder import StudyFolder

def marked(finish):
    def finished(*arguments):
        result = finish(*arguments)
        Path(__file__).with_name("begun").touch()
        return result
    return finished

Writer.add = marked(Writer.add)
StudyFolder.save_run = marked(StudyFolder.save_run)
sys.exit(cli.main())
"""


@dataclass(frozen=True)
class End:
    """
    How a process is ended.

    Fields
    ------
    number : Signals
    seconds : float
        When, from the start or from the first frame or run that is finished.
    begun : bool
        Which of the two.
    """

    number: signal.Signals
    seconds: float
    begun: bool


def ends(seed: int) -> list[End]:
    """SIGKILL and SIGTERM in turn, half of them while it starts and half while it renders."""
    seconds = np.random.default_rng(seed).uniform(0.0, 3.0, ENDS)
    return [
        End((signal.SIGKILL, signal.SIGTERM)[i % 2], float(s), i % 4 >= 2)
        for i, s in enumerate(seconds)
    ]


def ended(folder: Path, words: list[str], end: End) -> int:
    """Run a command, end it, and return its exit code."""
    program, mark = folder / "program.py", folder / BEGUN
    program.write_text(MARKING)
    mark.unlink(missing_ok=True)
    command = [sys.executable, str(program), *words]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            while end.begun and not mark.exists() and process.poll() is None:
                time.sleep(0.01)
            time.sleep(end.seconds)
            process.send_signal(end.number)
            error = process.communicate(timeout=60)[1]
        finally:
            process.kill()
    assert "Traceback" not in error, error
    assert process.returncode in (0, -end.number, 128 + end.number), error
    return process.returncode


def run(words: list[str]) -> None:
    """Run a command to its end."""
    subprocess.run([*COMMAND, *words], check=True, capture_output=True)


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
    words = ["evaluate", str(file), "-o"]
    codes: Counter[int] = Counter()
    grown: list[int] = []
    finished: dict[Path, int] = {}
    for end in ends(1):
        codes[ended(tmp_path, [*words, str(out)], end)] += 1
        now = whole(tmp_path)
        assert {path: now.get(path) for path in finished} == finished
        grown.append(len(now) - len(finished))
        finished = now
    print(f"\nevaluate: exit codes {dict(codes)}, new files after each {grown}")
    run([*words, str(out)])
    now = whole(tmp_path)
    assert {path: now.get(path) for path in finished} == finished
    assert not list(tmp_path.rglob(".*.partial"))
    run([*words, str(tmp_path / "whole")])
    assert numbers(out) == numbers(tmp_path / "whole")


def test_an_average(tmp_path):
    """After SIGTERM it is the mean of the first frames; after SIGKILL, what was there before."""
    picture = tmp_path / "mean.exr"
    words = ["render", "ajar", "--resolution", "16x9", "-p", "max_depth=3"]
    average = [*words, "--average", "--frames", "100000", "-o", str(picture)]
    codes: Counter[int] = Counter()
    means: list[tuple[int, np.ndarray]] = []
    for end in ends(2):
        before = picture.read_bytes() if picture.exists() else None
        code = ended(tmp_path, average, end)
        codes[code] += 1
        after = picture.read_bytes() if picture.exists() else None
        if code == -signal.SIGKILL:
            assert after == before
        elif end.begun:
            count = int(mi.Bitmap(str(picture)).metadata()["frames averaged"])
            means.append((count, imageio.read_rgb(picture)))
    counts = [count for count, _ in means]
    print(f"\nrender --average: exit codes {dict(codes)}, frames in each average {counts}")
    assert len(counts) == ENDS // 4

    run([*words, "--frames", str(max(counts)), "-o", str(tmp_path / "frame.exr")])
    total = np.zeros((9, 16, 3))
    sums = {}
    for frame in range(max(counts)):
        total = total + imageio.read_rgb(tmp_path / f"frame_{frame:04d}.exr")
        sums[frame + 1] = total
    for count, mean in means:
        np.testing.assert_array_equal(mean, (sums[count] / count).astype(np.float32))
