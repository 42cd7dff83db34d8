"""Benchmarks: kernels, rays, memory and the first frame, and their command."""

from __future__ import annotations

import csv
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import pytest

from benchmarks import kernels, memory, moving, previews, startup, task
from benchmarks.child import ask
from benchmarks.task import Task
from mitsuba_restir.errors import RenderError
from mitsuba_restir.studies import load_study
from mitsuba_restir.studies.runs.rendering import Renderer

ROOT = Path(__file__).parents[1]

STUDY = """
name = "measured"
scene = "cornell"
sizes = ["16x8", "32x16"]
max_depth = 4
frames = 2
warmup = 1
runs = 1
probe_runs = 1

[variants.path]
type = "path"

[variants.candidates]
type = "restir_pt"
temporal = false
spatial = false

[variants.frame]
type = "restir_pt"
"""


def _task(file: str, size: tuple[int, int], variant: str) -> Task:
    return Task(load_study(file), size, variant, 0)


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "measured.toml"
    path.write_text(STUDY)
    return str(path)


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["path", "frame"])
def test_no_kernel_is_compiled_after_warm_up(file: str, variant: str) -> None:
    numbers = ask("kernels", _task(file, (32, 16), variant))
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
    monkeypatch.setattr(task, "load_scene", lambda study: None)
    monkeypatch.setattr(task, "make_renderer", lambda *arguments: renderer)
    assert kernels.measure(_task(file, (4, 2), "path"))["kernels compiled per frame"] >= 1.0


def test_frames_with_a_preview_are_timed_beside_those_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(previews, "WARM", 1)
    monkeypatch.setattr(previews, "MEASURED", 2)
    path = tmp_path / "still.toml"
    path.write_text(STUDY + '[variants.still]\ntype = "still"\nplan = "spp=1"\n')
    numbers = previews.measure(_task(str(path), (32, 16), "still"))
    plain, steered, more = numbers.values()
    assert list(numbers)[:2] == ["plain frame", "frame with a preview"]
    assert min(plain, steered) > 0.0
    assert more == pytest.approx(100.0 * (steered / plain - 1.0))


@pytest.mark.slow
def test_rays_are_counted(file: str) -> None:
    candidates = ask("rays", _task(file, (32, 16), "candidates"))
    # One camera ray and at most one bounce for each of the remaining 3 edges, shadow rays likewise.
    assert 1.0 < candidates["nearest-hit rays"] <= 4.0
    assert 0.0 < candidates["shadow rays"] <= 3.0
    frame = ask("rays", _task(file, (32, 16), "frame"))
    # Three neighbours, shifted to and fro, and two temporal shifts: at most a shadow ray each.
    extra = frame["shadow rays"] - candidates["shadow rays"]
    assert 1.0 < extra <= 8.0
    assert ask("rays", _task(file, (32, 16), "path")) == {}


@pytest.mark.slow
def test_memory_by_its_command(file: str, tmp_path: Path) -> None:
    numbers = tmp_path / "memory.csv"
    command = [sys.executable, "-m", "benchmarks.memory", file, "-o", str(numbers)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "slope of the peak" in done.stdout
    found = {
        (row["size"], row["variant"], row["quantity"]): (float(row["value"]), row["unit"])
        for row in csv.DictReader(numbers.read_text().splitlines())
    }
    record, unit = found["32x16", "frame", "path record"]
    assert unit == "B/pixel"
    reservoir, _ = found["32x16", "frame", "reservoir"]
    kept, _ = found["32x16", "frame", "reservoir and primary hit"]
    assert 40.0 < record < reservoir < kept < 256.0
    assert found["32x16", "frame", "peak"][0] > 0.0
    assert found["32x16", "frame", "peak"][1] == "B"
    assert ("all", "frame", "slope of the peak, Dr.Jit's memory") in found


def test_what_moves(rgb, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moving, "SIZE", (16, 16))
    monkeypatch.setattr(moving, "CASES", {"light": moving.CASES["light"]})
    head, *lines = moving.lines(2, 32)
    assert head.startswith("cornell 16x16")
    assert [line.split(":")[0] for line in lines if "light" in line] == [
        f"light; {way}" for way in moving.WAYS
    ]
    assert all("mean/reference" in line for line in lines if line.startswith("light"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["no_such_study"], "'no_such_study' is neither a file nor a study of the package"),
        (["core_memory", "-s", "no_such_key=1"], "no_such_key"),
    ],
)
def test_bad_arguments_get_one_line(arguments: list[str], message: str) -> None:
    command = [sys.executable, "-m", "benchmarks.memory", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("benchmarks.memory: ")
    assert message in line


@pytest.mark.slow
def test_the_first_frame_finds_a_warm_cache(file: str) -> None:
    numbers = startup.cold_and_warm(_task(file, (16, 8), "candidates"))
    cold, warm = (numbers[f"first frame, {cache} kernel cache"] for cache in ("cold", "warm"))
    assert 0.0 < warm < cold


@pytest.mark.slow
def test_a_failing_benchmark_is_one_line(file: str) -> None:
    study = load_study(file, ["variants.frame.no_such_parameter=1"])
    with pytest.raises(RenderError, match=r"'kernels' of 'frame' failed: .*no_such_param"):
        ask("kernels", Task(study, (16, 8), "frame", 0))


def test_slopes_by_hand() -> None:
    answers = {
        size: [{"peak": 1e6 + slope * size[0] * size[1]} for slope in (300.0, 320.0)]
        for size in ((16, 8), (32, 16), (64, 32))
    }
    found = memory.slopes(answers)
    assert list(found) == ["slope of the peak, Dr.Jit's memory"]
    np.testing.assert_allclose(found["slope of the peak, Dr.Jit's memory"], [300.0, 320.0])
    assert memory.slopes({(16, 8): [{"peak": 1.0}]}) == {}


@pytest.mark.parametrize("file", sorted((ROOT / "benchmarks").glob("*.toml")), ids=lambda f: f.stem)
def test_studies_of_benchmarks_are_right(file: Path) -> None:
    assert load_study(str(file)).name == file.stem
