"""Probes: kernels, rays, memory, the first frame and statistics; the lock; the environment."""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import pytest

from mitsuba_restir.errors import RenderError, UsageError
from mitsuba_restir.studies import load_study, run_study
from mitsuba_restir.studies.config.tables import to_table
from mitsuba_restir.studies.measure import probe_child
from mitsuba_restir.studies.measure.probed import memory_slopes
from mitsuba_restir.studies.measure.results import Measured
from mitsuba_restir.studies.runs.probes import PROBES
from mitsuba_restir.studies.runs.rendering import Renderer
from mitsuba_restir.studies.store.environment import environment
from mitsuba_restir.studies.store.lock import FolderLock

STUDY = """
name = "probed"
scene = "cornell"
sizes = ["16x8", "32x16"]
max_depth = 4
frames = 2
warmup = 1
runs = 1
probe_runs = 1
quantities = ["kernels"]

[variants.path]
type = "path"

[variants.candidates]
type = "restir_pt"
temporal = false
spatial = false

[variants.frame]
type = "restir_pt"
"""


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "probed.toml"
    path.write_text(STUDY)
    return str(path)


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["path", "frame"])
def test_no_kernel_is_compiled_after_warm_up(file: str, variant: str) -> None:
    numbers = PROBES["kernels"](load_study(file), (32, 16), variant, 0)
    assert numbers["kernels compiled per frame"] == 0.0
    assert numbers["kernels read from disk per frame"] == 0.0
    assert numbers["kernels launched per frame"] >= 1.0


def test_a_seed_that_is_compiled_in_is_found(file: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("llvm_ad_rgb")
    # New in every session, so that no cache on disk knows it.
    never_seen = time.time() % 1e3

    def draw(seed: int) -> Any:
        # Small, or single precision would round to what an earlier session has compiled.
        row = mi.Float(seed % 1024) + never_seen + dr.arange(mi.Float, 24)
        return mi.TensorXf(row, (2, 4, 3))

    renderer = Renderer(draw, lambda: None, False)
    monkeypatch.setattr(probe_child, "load_scene", lambda study: None)
    monkeypatch.setattr(probe_child, "make_renderer", lambda *arguments: renderer)
    request = {"study": to_table(load_study(file)), "kind": "kernels", "size": [4, 2]}
    request |= {"variant": "path", "index": 0}
    monkeypatch.setattr("sys.stdin", io.StringIO(json.dumps(request)))
    answer = io.StringIO()
    with contextlib.redirect_stdout(answer):
        probe_child.main()
    assert json.loads(answer.getvalue())["kernels compiled per frame"] >= 1.0


@pytest.mark.slow
def test_rays_are_counted(file: str) -> None:
    study = load_study(file)
    candidates = PROBES["rays"](study, (32, 16), "candidates", 0)
    # One camera ray and at most one bounce for each of the remaining 3 edges, shadow rays likewise.
    assert 1.0 < candidates["nearest-hit rays"] <= 4.0
    assert 0.0 < candidates["shadow rays"] <= 3.0
    frame = PROBES["rays"](study, (32, 16), "frame", 0)
    # Three neighbours, shifted to and fro, and two temporal shifts: at most a shadow ray each.
    extra = frame["shadow rays"] - candidates["shadow rays"]
    assert 1.0 < extra <= 8.0
    assert PROBES["rays"](study, (32, 16), "path", 0) == {}


@pytest.mark.slow
def test_memory_and_statistics_become_rows(file: str, tmp_path: Path) -> None:
    study = load_study(file, ['quantities=["memory", "statistics"]'])
    table = run_study(study, tmp_path / "out")
    found = {(row.size, row.variant, row.quantity): row.value.value for row in table.rows}
    record = found["32x16", "frame", "path record"]
    reservoir = found["32x16", "frame", "reservoir"]
    assert 40.0 < record < reservoir < found["32x16", "frame", "reservoir and primary hit"] < 256.0
    assert found["32x16", "frame", "peak"] > 0.0
    assert ("all", "frame", "slope of the peak, Dr.Jit's memory") in found
    assert 0.5 < found["32x16", "frame", "matched"] <= 1.0
    outcomes = [v for (s, n, q), v in found.items() if q.startswith("spatial_0") and s == "32x16"]
    assert sum(outcomes) == pytest.approx(1.0)
    # Probes alone render no images, and are not measured twice.
    assert not (tmp_path / "out" / "runs").exists()
    files = {f: f.stat().st_mtime_ns for f in (tmp_path / "out" / "probes").rglob("*.json")}
    assert len(files) == 2 * 2 * 3
    assert run_study(study, tmp_path / "out").records() == table.records()
    assert {f: f.stat().st_mtime_ns for f in files} == files


@pytest.mark.slow
def test_the_first_frame_finds_a_warm_cache(file: str) -> None:
    numbers = PROBES["startup"](load_study(file), (16, 8), "candidates", 0)
    cold, warm = (numbers[f"first frame, {cache} kernel cache"] for cache in ("cold", "warm"))
    assert 0.0 < warm < cold


@pytest.mark.slow
def test_a_failing_probe_is_one_line(file: str) -> None:
    study = load_study(file, ["variants.frame.no_such_parameter=1"])
    with pytest.raises(RenderError, match=r"probe 'kernels' of 'frame' failed: .*no_such_param"):
        PROBES["kernels"](study, (16, 8), "frame", 0)


def test_slopes_by_hand() -> None:
    sizes = [
        Measured(
            size,
            {"a": []},
            "a",
            {},
            None,
            0.01,
            0.0,
            {("a", "memory"): [{"peak": 1e6 + slope * pixels} for slope in (300.0, 320.0)]},
        )
        for size, pixels in (("16x8", 128), ("32x16", 512), ("64x32", 2048))
    ]
    (row,) = memory_slopes(sizes)
    assert row.size == "all"
    assert row.value.value == pytest.approx(310.0)
    assert row.value.low < 300.0 < 320.0 < row.value.high


def test_machine_and_versions_are_recorded() -> None:
    found = environment()
    assert found["cores"] >= 1
    assert found["processor"]
    assert {"mitsuba", "drjit", "numpy", "mitsuba-restir"} <= found.keys()
    assert json.loads(json.dumps(found)) == found


def test_two_processes_cannot_share_a_folder(tmp_path: Path) -> None:
    lock = FolderLock(tmp_path)
    code = (
        "import sys; from pathlib import Path\n"
        "from mitsuba_restir.studies.store.lock import FolderLock\n"
        "FolderLock(Path(sys.argv[1]))"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "UsageError" in done.stderr
    assert "in use by another process" in done.stderr
    with pytest.raises(UsageError, match="in use"):
        FolderLock(tmp_path)
    lock.release()
    assert subprocess.run(command, check=False).returncode == 0
    assert np.array_equal([f.name for f in tmp_path.iterdir()], [".lock"])
