"""`mitsuba-restir evaluate`, studies changed as a whole, and runs on a cluster."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mitsuba_restir import cli
from mitsuba_restir.cli import evaluate
from mitsuba_restir.cli.arguments import OneLineParser
from mitsuba_restir.errors import RenderError, UsageError
from mitsuba_restir.studies import Study, load_study, packaged_studies, run_study, runner
from mitsuba_restir.studies.config.adapt import on_scene, quick, without
from mitsuba_restir.studies.measure.table import Table
from mitsuba_restir.studies.store.disk import lock_folder
from mitsuba_restir.studies.store.folder import StudyFolder

READY = ("thesis", "decorrelation", "blue_noise", "shifts", "convergence", "moving_camera")

REAL = """
name = "real"
scene = "cornell"
sizes = ["16x12"]
max_depth = 3
frames = 2
warmup = 1
runs = 4
quantities = ["relmse", "time"]

[reference]
spp = 256
batches = 4

[variants.path]
type = "path"

[variants.restir]
type = "restir_pt"
"""


pytestmark = pytest.mark.usefixtures("own_cache")


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "real.toml"
    path.write_text(REAL)
    return str(path)


def _evaluate(*arguments: str) -> int:
    parser = OneLineParser(prog="mitsuba-restir")
    evaluate.add_command(parser.add_subparsers())
    options = parser.parse_args(["evaluate", *arguments])
    return int(options.run(options))


def _numbers(path: Path) -> list[str]:
    lines = (path / "results.csv").read_text().splitlines()
    return [line for line in lines if "time" not in line]


@pytest.mark.parametrize("name", READY)
def test_ready_made_studies_are_there(name: str) -> None:
    assert name in packaged_studies()
    study = load_study(name)
    assert study.about
    small = quick(on_scene(study, "cornell"))
    assert small.scene == "cornell"
    assert small.view is None
    assert not small.published
    assert all(width * height <= 15000 for width, height in small.sizes)
    assert (small.reference is None) == (study.reference is None)
    assert small.runs * (small.frames + small.warmup) <= 4 * 14


def test_the_text_of_a_changed_study_is_true() -> None:
    study = load_study("thesis")
    for changed in (on_scene(study, "cornell"), quick(study), quick(on_scene(study, "cornell"))):
        first = changed.about.split("\n\n")[0]
        assert "No published values are shown. What follows is about the study as it was" in first
        assert changed.about.count("What follows") == 1
        assert changed.about.endswith(study.about)
    assert "in another scene" in on_scene(study, "cornell").about
    silent = replace(study, about="")
    assert "What follows" not in quick(silent).about


def test_the_users_own_keys_come_last(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Another scene and a quick look change many keys; those that were asked for stay."""
    seen: list[Study] = []

    def folder(path: Path, study: Study) -> StudyFolder:
        seen.append(study)
        raise UsageError("enough")

    monkeypatch.setattr(evaluate, "StudyFolder", folder)
    keys = ("-s", "runs=7", "-s", "reference.spp=8192", "-s", "sizes=['40x30']")
    with pytest.raises(UsageError, match="enough"):
        _evaluate("thesis", "--scene", "cornell", "--quick", *keys)
    (study,) = seen
    assert (study.scene, study.frames, study.runs, study.sizes) == ("cornell", 6, 7, ((40, 30),))
    assert study.reference is not None
    assert study.reference.spp == 8192
    # They may complete a study as well.
    part = tmp_path / "part.toml"
    part.write_text('name = "part"\nquantities = ["relmse"]\n[variants.path]\ntype = "path"\n')
    with pytest.raises(UsageError, match="enough"):
        _evaluate(str(part), "-s", "scene=cornell", "-s", "reference.spp=64")


def test_variants_can_be_left_out() -> None:
    study = without(load_study("thesis"), ["spatiotemporal", "path"])
    assert "path" not in study.variants
    # Who was compared with one that is gone is compared with the study's baseline.
    assert study.baseline_of("mutations_5") == study.baseline == "path_without_light_sampling"
    with pytest.raises(UsageError, match="no variant 'pth' to leave out: there are path"):
        without(load_study("core_time"), ["pth"])
    with pytest.raises(UsageError, match="no variant is left"):
        without(load_study("core_equal_time"), ["path", "restir"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing"], "neither a file nor a study of the package"),
        (["thesis", "--scene", "nowhere"], "neither a file nor an embedded scene"),
        (["shifts", "-s", "quantities=['rsme']"], "unknown quantity 'rsme'"),
        (["shifts", "-s", "variants.hybrid.shfit='hybrid'"], "variant 'hybrid'.*shfit"),
        (["shifts", "--quick", "--without", "x"], "no variant 'x'"),
        (["shifts", "-s", "reference.file='nowhere.exr'", "-s", "reference.spp=0"], "nowhere.exr"),
        (["shifts", "--reference", "nowhere.exr"], "nowhere.exr is not a file"),
        (["shifts", "--reference-variance", "v.exr"], "it needs --reference"),
        (["shifts", "--quick", "--reference", "r.exr"], "leave one of them out"),
    ],
)
def test_wrong_use_is_one_line(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MITSUBA_RESTIR_SCENES", str(tmp_path))
    with pytest.raises(UsageError, match=message) as found:
        _evaluate(*arguments)
    assert "\n" not in str(found.value)
    assert not (tmp_path / "out").exists()


def test_a_read_only_output_is_one_line(file: str, tmp_path: Path) -> None:
    folder = tmp_path / "sealed"
    folder.mkdir(mode=0o555)
    if os.access(folder, os.W_OK):
        # Root writes everywhere, but not into what the kernel shows.
        folder = Path("/proc/sys/kernel")
        if not folder.is_dir():
            pytest.skip("no folder here refuses root")
    with pytest.raises((UsageError, RenderError), match=r"cannot (make|write)"):
        run_study(load_study(file), folder / "out")


@pytest.mark.slow
def test_a_full_disk_loses_nothing(file: str, tiny_disk: Path, tmp_path: Path) -> None:
    """A real disk runs full; with room again, the study goes on to the same numbers."""
    out = tiny_disk / "out"
    ballast = tiny_disk / "ballast"
    ballast.write_bytes(bytes(80 << 10))
    study = load_study(file)
    with pytest.raises(RenderError, match=r"cannot write .*: No space left on device") as found:
        run_study(study, out)
    assert "\n" not in str(found.value)
    assert not list(out.rglob("*.partial"))
    finished = {f: f.read_bytes() for f in out.rglob("*.npz")}
    ballast.unlink()
    run_study(study, out)
    assert {f: f.read_bytes() for f in finished} == finished
    run_study(study, tmp_path / "whole")
    assert _numbers(out) == _numbers(tmp_path / "whole")


@pytest.mark.slow
def test_a_reference_of_the_user(file: str, tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("llvm_ad_rgb")
    for name, level, width in (("r", 0.5, 16), ("v", 1e-4, 16), ("wrong", 0.5, 17)):
        image = np.full((12, width, 3), level, dtype=np.float32)
        mi.Bitmap(image).write(str(tmp_path / f"{name}.exr"))
    own = ["--reference", str(tmp_path / "r.exr")]
    variance = ["--reference-variance", str(tmp_path / "v.exr")]
    out = tmp_path / "out"
    assert _evaluate(file, "-o", str(out), *own, *variance, "-s", "runs=2") == 0
    config = (out / "config.toml").read_text()
    assert f'file = "{tmp_path / "r.exr"}"' in config
    assert f'variance = "{tmp_path / "v.exr"}"' in config
    assert " ".join([*own, *variance]) in (out / "report.html").read_text("utf-8")
    with pytest.raises(UsageError, match=r"wrong\.exr has 17x12 pixels, the study 16x12"):
        _evaluate(file, "-o", str(tmp_path / "no"), "--reference", str(tmp_path / "wrong.exr"))
    assert not (tmp_path / "no").exists()


@pytest.mark.slow
def test_a_study_ends_in_a_report(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "out"
    assert _evaluate(file, "-o", str(out), "--quick", "-s", "max_depth=4") == 0
    page = (out / "report.html").read_text("utf-8")
    assert f"mitsuba-restir evaluate {file} -o {out} --quick -s max_depth=4" in page
    assert f"Report: {out / 'report.html'}" in capsys.readouterr().out


def test_ctrl_c_says_how_to_go_on(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluate, "run_folder", interrupted)
    assert cli.main(["evaluate", file, "-o", str(tmp_path / "out")]) == cli.INTERRUPTED
    assert capsys.readouterr().err.splitlines() == [
        "mitsuba-restir: interrupted; finished runs are kept, the same command goes on"
    ]


def test_the_folder_is_locked_until_the_report_is_written(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"

    def write(folder: StudyFolder, table: Table, command: str) -> Path:
        with pytest.raises(UsageError, match="in use by another process"):
            lock_folder(out)
        return out

    monkeypatch.setattr(runner, "render_missing", lambda *arguments: None)
    monkeypatch.setattr(runner, "measure", lambda folder: Table([]))
    monkeypatch.setattr(evaluate, "write_report", write)
    assert _evaluate(file, "-o", str(out)) == 0
    lock_folder(out).release()


KILLER = """
import os, signal, sys
from pathlib import Path
from mitsuba_restir.studies import load_study, run_study

def kill(done, total, text):
    if done == int(sys.argv[3]):
        os.kill(os.getpid(), signal.SIGKILL)

run_study(load_study(sys.argv[1]), Path(sys.argv[2]), kill)
"""


@pytest.mark.slow
def test_killed_three_times_and_gone_on_with(file: str, tmp_path: Path) -> None:
    study = load_study(file)
    out = tmp_path / "killed"
    finished: dict[Path, int] = {}
    for moment in (8, 3, 11):
        command = [sys.executable, "-c", KILLER, file, str(out), str(moment)]
        assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
        now = {f: f.stat().st_mtime_ns for f in out.rglob("*.npz")}
        # No finished run is rendered again.
        assert {f: now[f] for f in finished} == finished
        finished = now
    assert finished
    run_study(study, out)
    run_study(study, tmp_path / "whole")
    assert _numbers(out) == _numbers(tmp_path / "whole")


WRITING_KILLER = """
import os, signal, sys
from pathlib import Path
from mitsuba_restir.studies import load_study, run_study

left = int(sys.argv[3])
sync = os.fsync

def kill(handle):
    global left
    left -= 1
    if left == 0:
        os.ftruncate(handle, 100)
        os.kill(os.getpid(), signal.SIGKILL)
    sync(handle)

os.fsync = kill
run_study(load_study(sys.argv[1]), Path(sys.argv[2]))
"""


@pytest.mark.slow
def test_killed_while_it_writes(file: str, tmp_path: Path) -> None:
    """Killed with a file half written, five times: what is half written is never taken."""
    study = load_study(file)
    out = tmp_path / "killed"
    # The first two are the history and the configuration of the folder itself.
    for write in (1, 2, 4, 7, 9):
        command = [sys.executable, "-c", WRITING_KILLER, file, str(out), str(write)]
        assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
        assert list(tmp_path.rglob(".*.partial"))
    table = run_study(study, out)
    assert not table.notes
    assert not list(out.rglob(".*.partial"))
    run_study(study, tmp_path / "whole")
    assert _numbers(out) == _numbers(tmp_path / "whole")


@pytest.mark.slow
def test_a_cluster_gives_the_same_numbers(file: str, tmp_path: Path) -> None:
    distributed: Any = pytest.importorskip(
        "distributed", reason="the cluster test needs Dask: pip install 'dask[distributed]'"
    )
    from mitsuba_restir.studies.runs.dask_cluster import dask_cluster

    study = load_study(file)
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as local,
        dask_cluster(local.scheduler_address) as cluster,
    ):
        run_study(study, tmp_path / "cluster", cluster=cluster)
    run_study(study, tmp_path / "here")
    assert _numbers(tmp_path / "cluster") == _numbers(tmp_path / "here")


def test_a_cluster_that_does_not_answer_is_one_line() -> None:
    pytest.importorskip("distributed")
    from mitsuba_restir.studies.runs import dask_cluster as module

    with pytest.raises(UsageError, match="no scheduler answers"), module.dask_cluster("nowhere"):
        pass


@pytest.mark.slow
def test_a_moving_camera_arrives_at_the_view(tmp_path: Path) -> None:
    path = tmp_path / "moving.toml"
    quantities = 'quantities = ["mean_ratio", "statistics"]'
    text = REAL.replace('quantities = ["relmse", "time"]', quantities)
    text = text.replace("frames = 2\nwarmup = 1", "frames = 1\nwarmup = 6")
    text = text.replace("spp = 256", "spp = 2048").replace("runs = 4", "runs = 12")
    path.write_text(f"{text}\n[motion]\nstep = [0.05, 0.0, 0.0]\n")
    table = run_study(load_study(str(path)), tmp_path / "out")
    rows = {(row.variant, row.quantity): row.value for row in table.rows}
    # Seen from where the reference is, and with a history that has moved along.
    for name in ("path", "restir"):
        ratio = rows[name, "mean ratio"]
        assert abs(ratio.value - 1.0) < 4.0 * ratio.standard_error + 0.01
    assert 0.3 < rows["restir", "matched"].value < 0.95
    with pytest.raises(UsageError, match="frames must be 1"):
        load_study(str(path), ["frames=2"])
