"""Probes of statistics; the lock; the environment."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mitsuba_restir.errors import UsageError
from mitsuba_restir.studies import load_study, run_study
from mitsuba_restir.studies.measure.asked import BENCHMARKS
from mitsuba_restir.studies.runs.software import environment
from mitsuba_restir.studies.store.disk import lock_folder

STUDY = """
name = "probed"
scene = "cornell"
sizes = ["16x8", "32x16"]
max_depth = 4
frames = 2
warmup = 1
runs = 1
probe_runs = 1
quantities = ["statistics"]

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
def test_statistics_become_rows(file: str, tmp_path: Path) -> None:
    study = load_study(file)
    table = run_study(study, tmp_path / "out")
    found = {(row.size, row.variant, row.quantity): row.value.value for row in table.rows}
    assert 0.5 < found["32x16", "frame", "matched"] <= 1.0
    outcomes = [v for (s, n, q), v in found.items() if q.startswith("spatial_0") and s == "32x16"]
    assert sum(outcomes) == pytest.approx(1.0)
    # Probes alone render no images, and are not measured twice.
    assert not (tmp_path / "out" / "runs").exists()
    files = {f: f.stat().st_mtime_ns for f in (tmp_path / "out" / "probes").rglob("*.json")}
    assert len(files) == 2 * 3
    assert run_study(study, tmp_path / "out").records() == table.records()
    assert {f: f.stat().st_mtime_ns for f in files} == files


@pytest.mark.parametrize("name", BENCHMARKS)
def test_what_is_a_benchmark_says_where_it_is(file: str, tmp_path: Path, name: str) -> None:
    study = load_study(file, [f'quantities=["{name}"]'])
    with pytest.raises(UsageError, match=rf"'{name}' is a benchmark.*python -m benchmarks\.{name}"):
        run_study(study, tmp_path / "out")


def test_machine_and_versions_are_recorded() -> None:
    found = environment()
    assert found["cores"] >= 1
    assert found["processor"]
    assert {"mitsuba", "drjit", "numpy", "mitsuba-restir"} <= found.keys()
    assert json.loads(json.dumps(found)) == found


def test_two_processes_cannot_share_a_folder(tmp_path: Path) -> None:
    lock = lock_folder(tmp_path)
    code = (
        "import sys; from pathlib import Path\n"
        "from mitsuba_restir.studies.store.disk import lock_folder\n"
        "lock_folder(Path(sys.argv[1]))"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "UsageError" in done.stderr
    assert "in use by another process" in done.stderr
    with pytest.raises(UsageError, match="in use"):
        lock_folder(tmp_path)
    lock.release()
    assert subprocess.run(command, check=False).returncode == 0
    assert np.array_equal([f.name for f in tmp_path.iterdir()], [".lock"])


DENOISED = """
name = "guided"
scene = "cornell"
sizes = ["32x16"]
max_depth = 4
frames = 2
warmup = 1
probe_runs = 2
quantities = ["denoised_guided"]

[reference]
spp = 512
batches = 4

[variants.path]
type = "path"

[variants.frame]
type = "restir_pt"

[variants.many]
type = "restir_pt"
spp = 64
"""


@pytest.mark.slow
def test_denoised_frames_are_measured_with_guides(tmp_path: Path) -> None:
    pytest.importorskip("mitsuba_oidn")
    (tmp_path / "guided.toml").write_text(DENOISED)
    table = run_study(load_study(str(tmp_path / "guided.toml")), tmp_path / "out")
    found = {(row.variant, row.quantity): row for row in table.rows}
    name = "relMSE after OIDN with albedo and normals"
    # Auxiliary images are those of restir_pt: path has none.
    assert {variant for variant, _ in found} == {"frame", "many"}
    assert 0.0 < found["many", name].value.value < found["frame", name].value.value
    assert found["frame", f"{name}, trimmed"].value.value <= found["frame", name].value.value


def test_a_denoiser_that_is_missing_is_said_before_anything_is_rendered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "guided.toml").write_text(DENOISED)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    study = load_study(str(tmp_path / "guided.toml"))
    with pytest.raises(UsageError, match="'denoised_guided' needs pip install mitsuba-oidn"):
        run_study(study, tmp_path / "out")
