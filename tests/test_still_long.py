"""A minute of a still at 1280x720, and many short ones with a pilot each.

``make test-long ARGS='tests/test_still_long.py -s'`` prints memory and plans.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from support import references, rooms
from support.runs import assert_unbiased, bias_report

from mitsuba_restir import cli, still
from mitsuba_restir.arrays import load_arrays
from mitsuba_restir.still import pilot

pytestmark = pytest.mark.long

STILL = ["still", "ajar", "--resolution", "1280x720", "--max-depth", "6"]
PIXELS = 1280 * 720
STATUS = Path("/proc/self/status")
COMMAND = [sys.executable, "-m", "mitsuba_restir"]


def resident(process: int) -> int:
    """Bytes of memory that a process has."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    (line,) = (line for line in lines if line.startswith("VmRSS"))
    return 1024 * int(line.split()[1])


@pytest.mark.skipif(not STATUS.exists(), reason="memory is read from /proc, as on Linux")
def test_memory_of_a_minute(tmp_path):
    found = []
    command = [*COMMAND, *STILL, "--time-budget", "60", "--checkpoint-every", "5"]
    with subprocess.Popen([*command, "-o", str(tmp_path / "a")]) as process:
        begin = time.monotonic()
        while process.poll() is None:
            if process.poll() is None and time.monotonic() - begin > 20:
                found.append(resident(process.pid))
            time.sleep(0.25)
    assert process.returncode == 0
    early, late = (np.array(part, dtype=float) for part in np.array_split(found[:-4], 2))
    print(
        f"\nresident: {early.max() / 1e6:.0f} MB up to {len(early) / 4 + 20:.0f} s, "
        f"{late.max() / 1e6:.0f} MB later; {late.max() / PIXELS:.0f} B a pixel; checkpoint "
        f"{(tmp_path / 'a.checkpoint').stat().st_size / PIXELS:.0f} B a pixel"
    )
    assert late.max() < 1.03 * early.max()


def test_killed_at_real_size(tmp_path, monkeypatch):
    """SIGKILL at three moments, one resumed after the other, beside an uninterrupted one."""
    monkeypatch.chdir(tmp_path)
    kept, frames = Path("a.checkpoint"), 0
    words = [*STILL, "--plan", "rounds_guided", "--checkpoint-every", "2", "--frames"]
    for seconds in (0.0, 1.7, 2.9):
        more = ["--resume"] if kept.exists() else []
        with subprocess.Popen([*COMMAND, *words, "100000", "-o", "a", *more]) as process:
            while process.poll() is None and frames_in(kept) <= frames:
                time.sleep(0.05)
            time.sleep(seconds)
            process.send_signal(signal.SIGKILL)
        assert process.returncode == -signal.SIGKILL
        frames = frames_in(kept)
    count = str(frames + 2)
    assert cli.main([*words, count, "-o", "a", "--resume"]) == 0
    assert cli.main([*words, count, "-o", "b"]) == 0
    np.testing.assert_array_equal(*(np.array(mi.Bitmap(f"{name}.exr")) for name in "ab"))


def frames_in(path: Path) -> int:
    return int(load_arrays(path)[1]["frames"]) if path.exists() else 0


def test_stills_with_a_pilot_each_are_unbiased(rgb, monkeypatch):
    """64 of them against `path`: whatever a pilot chooses, its frames are not in the picture."""
    monkeypatch.setattr(pilot, "LONGEST", 1.0)
    scene = mi.load_dict(rooms.room())
    plans: Counter[str] = Counter()

    def runs() -> Iterator[np.ndarray]:
        for seed in range(64):
            picture = still.render(scene, max_depth=5, seed=seed, frames=5)
            plans[picture.plan.name] += 1
            yield picture.image.astype(np.float64)

    report = bias_report(runs(), 64, *references.load("room"))
    print(f"\n{dict(plans)}\n{report}")
    assert_unbiased(report, "still-pilot", 0.05)
