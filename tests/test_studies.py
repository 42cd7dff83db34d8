"""Studies: reading them, running, stopping, going on, and refusing what cannot be trusted."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import sys
import time
import zipfile
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from support.disks import refuse

import mitsuba_restir.studies.runner as runner
import mitsuba_restir.studies.runs.turns as runs_module
import mitsuba_restir.studies.store.reference as reference_module
from mitsuba_restir import cache, cli, studies
from mitsuba_restir.analysis.metrics import relmse
from mitsuba_restir.arrays import load_arrays, save_arrays
from mitsuba_restir.errors import RenderError, UsageError
from mitsuba_restir.imageio import encode_exr, write_atomically
from mitsuba_restir.studies import load_study, packaged_studies, run_study
from mitsuba_restir.studies.config.files import dump_study
from mitsuba_restir.studies.config.study import Reference, Study, Variant
from mitsuba_restir.studies.config.tables import from_table, to_table
from mitsuba_restir.studies.measure.asked import check_quantities
from mitsuba_restir.studies.measure.probes import GUIDED, GUIDED_TRIMMED
from mitsuba_restir.studies.measure.quantities import QUANTITIES
from mitsuba_restir.studies.report.words import facts
from mitsuba_restir.studies.runs.reference import smooth
from mitsuba_restir.studies.runs.rendering import Renderer, seed_of
from mitsuba_restir.studies.runs.results import ReferenceImage
from mitsuba_restir.studies.runs.scene import scene_digest
from mitsuba_restir.studies.runs.software import software
from mitsuba_restir.studies.store.folder import StudyFolder

STUDY = """
name = "small"
scene = "ajar"
sizes = ["24x16"]
frames = 3
warmup = 1
runs = 3
seed = 5
quantities = ["rmse", "relmse", "mean_ratio", "time"]

[reference]
spp = 64
batches = 4

[variants.plain]
type = "path"

[variants.better]
type = "path"
spp = 4
"""


pytestmark = pytest.mark.usefixtures("own_cache")


@pytest.fixture
def study(tmp_path: Path) -> Study:
    file = tmp_path / "small.toml"
    file.write_text(STUDY)
    return load_study(str(file))


def _fake(
    log: list[tuple[str, int]],
) -> Callable[[Study, Any, tuple[int, int], str, Variant], Renderer]:
    """Noise about a gradient, from the seed and, where it has one, the history."""

    def make(
        study: Study, scene: Any, size: tuple[int, int], name: str, variant: Variant
    ) -> Renderer:
        history: list[int] = []

        def draw(seed: int) -> Any:
            log.append((name, seed))
            history.append(seed)
            rng = np.random.default_rng([seed, len(history) if name == "better" else 0])
            truth = np.linspace(0.5, 1.5, size[0])[None, :, None]
            shape = (size[1], size[0], 3)
            return truth * rng.lognormal(-0.02, 0.2 / np.sqrt(variant.spp), shape)

        class Fake(Renderer):
            def frame(self, seed: int) -> tuple[Any, float]:
                return self.draw(seed).astype(np.float32), 0.01

        return Fake(draw, history.clear, name == "better")

    return make


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Replace Mitsuba by noise, and record which variant rendered which seed."""
    entries: list[tuple[str, int]] = []
    monkeypatch.setattr(runner, "load_scene", lambda study: None)
    monkeypatch.setattr(runner, "make_renderer", _fake(entries))
    monkeypatch.setattr(reference_module, "make_renderer", _fake(entries))
    probes = {**dict.fromkeys(runner.PROBES, _fake_probe), "guided_denoising": _fake_denoising}
    monkeypatch.setattr(runner, "PROBES", probes)
    return entries


def _fake_probe(
    study: Study, size: tuple[int, int], variant: str, index: int, reference: Any
) -> dict[str, float]:
    return {
        "peak": 1e6 + 500.0 * size[0] * size[1] + index,
        "number": float(index),
        "duplicated paths r=8, after mutations": 0.5,
        "light": 0.5,
    }


def _fake_denoising(*_: object) -> dict[str, float]:
    return {GUIDED: 0.5, GUIDED_TRIMMED: 0.25}


def _view(**changes: object) -> str:
    keys = {"fov": 60, "origin": "[1, 2, 3]", "target": "[1, 2, 4]", **changes}
    return "view = {" + ", ".join(f"{key} = {value}" for key, value in keys.items()) + "}"


def _numbers(path: Path) -> list[dict[str, Any]]:
    records = json.loads((path / "results.json").read_text())
    return [record for record in records if not record["quantity"].startswith("time")]


def _files(path: Path) -> dict[str, bytes]:
    return {str(f.relative_to(path)): f.read_bytes() for f in sorted(path.rglob("*.npz"))}


ROOMS = ("config", "runs", "store", "measure", "report")


def test_rooms_use_only_those_before_them() -> None:
    house = Path(studies.__file__).parent
    for place, room in enumerate(ROOMS):
        for file in (house / room).rglob("*.py"):
            used = set(re.findall(r"^ *from \.\.(\w+)", file.read_text("utf-8"), re.MULTILINE))
            assert used <= set(ROOMS[:place]), file


def test_a_study_survives_its_own_toml(study: Study, tmp_path: Path) -> None:
    file = tmp_path / "again.toml"
    file.write_bytes(dump_study(study))
    assert load_study(str(file)) == study
    assert from_table(to_table(study), "table") == study
    assert study.baseline == "plain"


@pytest.mark.parametrize("name", packaged_studies())
def test_packaged_studies_are_sound(name: str) -> None:
    study = load_study(name)
    assert study.name == name
    assert load_study(name, ["runs=7"]).runs == 7
    check_quantities(study)


def test_a_study_has_the_keys_of_its_base(study: Study, tmp_path: Path) -> None:
    (tmp_path / "child.toml").write_text('name = "child"\nbase = "small.toml"\nruns = 5\n')
    variants = '[variants.only]\ntype = "path"\n'
    (tmp_path / "grandchild.toml").write_text(
        f'name = "grandchild"\nbase = "child.toml"\nseed = 9\n{variants}'
    )
    child, grandchild = (
        load_study(str(tmp_path / f"{name}.toml")) for name in ("child", "grandchild")
    )
    assert child == replace(study, name="child", runs=5)
    only = {"only": Variant("path")}
    assert grandchild == replace(child, name="grandchild", seed=9, variants=only, baseline="only")
    # What a folder keeps is complete.
    assert "base =" not in dump_study(child).decode()


def test_what_is_seen_of_a_scene_is_not_what_is_seen_of_another(tmp_path: Path) -> None:
    view = "[view]\nfov = 60\norigin = [1, 2, 3]\ntarget = [0, 0, 0]\n"
    (tmp_path / "near.toml").write_text(f"crop = [0, 0, 0.5, 0.5]\n{STUDY}\n{view}")
    for scene in ("", 'scene = "ajar"\n', 'scene = "cornell"\n'):
        (tmp_path / "child.toml").write_text(f'name = "child"\nbase = "near.toml"\n{scene}')
        child = load_study(str(tmp_path / "child.toml"))
        assert (child.view is None) == (child.crop is None) == bool(scene)
    (tmp_path / "child.toml").write_text(f'base = "near.toml"\nscene = "cornell"\n{view}')
    assert load_study(str(tmp_path / "child.toml")).view is not None


@pytest.mark.parametrize("name", [n for n in packaged_studies() if n.endswith("_whole")])
def test_whole_views_are_the_scenes_own(name: str) -> None:
    assert load_study(name).view is None


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ('"bad.toml"', "base = 'bad.toml' leads back to itself"),
        ('"nowhere"', "'nowhere' is neither a file nor a study of the package"),
        ("1", "base must be a string, not 1"),
    ],
)
def test_a_base_that_is_none(base: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text(f'name = "bad"\nbase = {base}\n')
    with pytest.raises(UsageError, match=message):
        load_study(str(tmp_path / "bad.toml"))


def test_keys_can_be_changed(study: Study, tmp_path: Path) -> None:
    changed = load_study(
        str(tmp_path / "small.toml"),
        ["runs=9", 'sizes=["8x8"]', "scene=cornell", "variants.better.hide_emitters=true"],
    )
    assert (changed.runs, changed.sizes, changed.scene) == (9, ((8, 8),), "cornell")
    assert changed.variants["better"].parameters == {"hide_emitters": True}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("runs = 3", "runs = 0", "runs must be an integer of at least 1, not 0"),
        ("runs = 3", "runs = true", "runs must be an integer"),
        ("runs = 3", "rnus = 3", "unknown key 'rnus'"),
        ("runs = 3", "runs = ", "is no TOML"),
        ('name = "small"', "", "'name' is missing"),
        ('"24x16"', '"24"', "sizes must be like '320x180'"),
        ('"24x16"', '"0x16"', "sizes must be like '320x180'"),
        ('sizes = ["24x16"]', "sizes = []", "a list of strings"),
        ('"rmse"', '"rsme"', "unknown quantity 'rsme'; there are time, speed"),
        ('"rmse"', '"equal_time"', "needs warmup = 0"),
        ('"rmse"', '"temporal_covariance"', "needs keep = 'all' and at least 2 frames"),
        (
            "runs = 3\nseed = 5\nquantities = [",
            'runs = 1\nquantities = ["bands", ',
            "at least 2 runs",
        ),
        ("spp = 64\nbatches = 4", "batches = 4", "give one of file, spp and seconds"),
        ("batches = 4", "batches = 5", "no multiple of the 5 batches"),
        ("[reference]\nspp = 64\nbatches = 4", "", "needs a [reference]"),
        ('type = "path"\n\n', 'typ = "path"\n\n', "[variants] [plain]: 'type' is missing"),
        ("[variants.plain]", "[variants.'../x']", "cannot name a variant"),
        ("seed = 5", 'seed = 5\nbaseline = "other"', "the baseline 'other' is none"),
        ("seed = 5", 'seed = 5\nkeep = "some"', "keep must be 'last' or 'all'"),
        ("seed = 5", "seed = 5\nview = {fov = 60, origin = [1, 2]}", "origin must be three"),
        ("spp = 4", "spp = 4\nlist = [1]", "list must be a number, a string"),
        ("seed = 5", "seed = 5\ncrop = [0.5, 0.5, 0.6, 0.5]", "crop must be left, top, width"),
        ("seed = 5", "seed = 5\ncrop = [0, 0, 1]", "crop must be 4 finite numbers"),
        ("seed = 5", "seed = 5\ncrop = [nan, 0, 1, 1]", "crop must be 4 finite numbers"),
        ("seed = 5", f"seed = 5\nepsilon = 1{'0' * 400}", "epsilon must be a positive number"),
        ("spp = 64", "spp = 64\nnoise = -1", "noise must be a number >= 0"),
        ("seed = 5", f"seed = 5\n{_view(fov=180)}", "fov must be a positive number and < 180"),
        ("seed = 5", f"seed = 5\n{_view(origin='[0, inf, 0]')}", "origin must be three finite"),
        ("seed = 5", f"seed = 5\n{_view(target='[1, 2, 3]')}", "target must differ from origin"),
        ("seed = 5", f"seed = 5\n{_view(up='[0, 0, 2]')}", "up must point elsewhere"),
        ("seed = 5", "seed = 5\ntrim = 1", "trim must be a number >= 0 and < 1, not 1"),
        ('"24x16"', '"24x16", "024x16"', "sizes has 24x16 twice"),
        ("seed = 5", "mitsuba_variant = 'llvm_ad_mono'", "as in llvm_ad_rgb or cuda_ad_rgb, not"),
        ("seed = 5", "mitsuba_variant = 'scalar_rgb'", "as in llvm_ad_rgb or cuda_ad_rgb, not"),
        ("spp = 64", "spp = 64\nvariance = 'v.exr'", "variance goes with file"),
        ('name = "small"', 'name = "../small"', r"without / and \, not '../small'"),
        ("[variants.plain]", "[variants.reference]", "'reference' is what the truth is called"),
    ],
)
def test_bad_toml_is_refused_in_one_line(
    old: str, new: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert old in STUDY
    file = tmp_path / "bad.toml"
    file.write_text(STUDY.replace(old, new, 1))
    assert cli.main(["evaluate", str(file), "-o", str(tmp_path / "out")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert message in lines[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.toml", "-o", "out"], "neither a file nor a study"),
        (["core_time", "-o", "out", "-s", "runs"], "must be key=value"),
        (["core_time", "-o", "out", "-s", "runs.x=1"], "'runs' is no table"),
        (["core_time", "-o", "out", "-s", "scene=$NOT_SET_ANYWHERE/x.xml"], "set the environment"),
        (["core_time", "-o", "out", "-s", "scene=nowhere"], "neither a file nor an embedded"),
        (["core_time", "-o", "out", "-s", "mitsuba_variant=cpu"], "mitsuba_variant"),
        (["core_time", "-s", "variants.pth.spp=4"], "no variant 'pth' to change: there are path,"),
        (["core_time", "-s", "published.pth.RMSE=1"], "published values of 'pth', which is none"),
        (["shifts", "-o", "x" * 300], "File name too long"),
    ],
)
def test_wrong_use_is_one_line(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["evaluate", *arguments]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert message in lines[0]
    assert not list(tmp_path.iterdir())


def test_variants_take_turns_on_equal_seeds(
    study: Study, tmp_path: Path, log: list[tuple[str, int]]
) -> None:
    run_study(study, tmp_path / "out")
    frames = [entry for entry in log if entry[0] != "reference"][6:]
    first_run = frames[: 4 + 3]
    # One frame of warm-up for the variant with a history, then both in changing order.
    names = [name for name, _ in first_run]
    assert names == ["better", "better", "plain", "plain", "better", "better", "plain"]
    seeds = {name: [s for n, s in first_run if n == name] for name in ("plain", "better")}
    assert seeds["better"][1:] == seeds["plain"]
    everything = [seed for name, seed in frames if name == "better"]
    assert len(set(everything)) == len(everything) == 3 * 4
    references = {seed for name, seed in log if name == "reference"}
    assert len(references) == 4
    assert not references & set(everything)


def test_seeds_are_32_bits_and_differ() -> None:
    seeds = {seed_of(1, 0, run, frame) for run in range(50) for frame in range(50)}
    assert len(seeds) == 2500
    assert max(seeds) < 2**32
    assert seed_of(1, 0, 2, 3) != seed_of(2, 0, 2, 3)


def test_the_numbers_are_those_of_the_images(
    study: Study, tmp_path: Path, log: list[tuple[str, int]]
) -> None:
    table = run_study(study, tmp_path / "out")
    folder = StudyFolder(tmp_path / "out", study)
    truth = np.mean([folder.load_batch((24, 16), b) for b in range(4)], axis=0, dtype=np.float64)
    variance = np.var(
        [folder.load_batch((24, 16), b) for b in range(4)], axis=0, ddof=1, dtype=np.float64
    )
    errors = []
    for index in range(3):
        run = folder.load_run((24, 16), "plain", index)
        assert run is not None
        assert run.times.shape == (3,)
        errors.append(np.sqrt(np.mean((run.last.astype(float) - truth) ** 2 - variance / 4)))
    row = next(r for r in table.rows if r.quantity == "RMSE" and r.variant == "plain")
    assert row.value.value == pytest.approx(np.mean(errors), rel=1e-6)
    other = next(r for r in table.rows if r.quantity == "RMSE" and r.variant == "better")
    assert other.ratio is not None
    assert other.ratio.low < other.ratio.value < other.ratio.high < 1.0
    text = (tmp_path / "out" / "results.csv").read_text()
    records = list(csv.DictReader(text.splitlines()))
    assert [float(r["value"]) for r in records] == [r.value.value for r in table.rows]


def test_published_values_are_a_column(
    tmp_path: Path, study: Study, log: list[tuple[str, int]]
) -> None:
    assert "published" not in run_study(study, tmp_path / "out").csv()
    file = str(tmp_path / "small.toml")
    table = run_study(load_study(file, ["published.better.RMSE=0.125"]), tmp_path / "out")
    for records in (table.records(), json.loads(table.json())):
        found = {(r["variant"], r["quantity"]): r["published"] for r in records}
        assert found["better", "RMSE"] == 0.125
        assert found["plain", "RMSE"] is None
    lines = list(csv.DictReader(table.csv().splitlines()))
    assert sorted({line["published"] for line in lines}) == ["", "0.125"]
    console = Console(width=200, record=True, file=io.StringIO())
    table.show(console, "title")
    assert re.search(r"published.*better[^\n]* 0\.125 ", console.export_text(), re.DOTALL)
    # Of what was not measured, nothing is shown.
    table = run_study(load_study(file, ["published.better.relRMSE=0.125"]), tmp_path / "out")
    assert "published" not in table.csv()


# Those that need stills, or several variants of `path`, are measured in `test_studies_stills.py`.
@pytest.mark.parametrize("name", sorted({*QUANTITIES} - {"as_long", "previews", "stated"}))
def test_every_quantity_can_be_measured(
    name: str, tmp_path: Path, study: Study, log: list[tuple[str, int]]
) -> None:
    if "flip" in name:
        pytest.importorskip("flip_evaluator")
    if name in ("denoised", "denoised_guided", "average", "flicker"):
        pytest.importorskip("mitsuba_oidn")
    changes = [f'quantities=["{name}"]', "warmup=0", "keep='all'", 'sizes=["48x32"]']
    changes += ["reference.spp=4096", "runs=4"]
    table = run_study(load_study(str(tmp_path / "small.toml"), changes), tmp_path / "out")
    assert {row.variant for row in table.rows} >= {"better"}
    declared = {number.name: number.unit for number in QUANTITIES[name].numbers}
    if declared:
        assert {row.quantity: row.unit for row in table.rows}.items() <= declared.items()
    assert all(np.isfinite(row.value.value) for row in table.rows)
    if name != "block_bias":
        assert all(np.isfinite(row.value.low) for row in table.rows)
    ratios = [row.ratio.value for row in table.rows if row.ratio is not None]
    assert all(ratio > 0.0 for ratio in ratios) or "covariance" in name


def test_without_flip_one_line_says_so_and_all_else_is_measured(
    tmp_path: Path,
    study: Study,
    log: list[tuple[str, int]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    changes = ['quantities=["flip", "rmse"]']
    table = run_study(load_study(str(tmp_path / "small.toml"), changes), tmp_path / "out")
    assert {row.quantity for row in table.rows} == {"RMSE"}
    (note,) = table.notes
    assert note.startswith("flip at 24x16 is not given in full: HDR-FLIP needs flip-evaluator")
    assert "\n" not in note


def test_quantities_that_share_numbers_give_them_once(
    tmp_path: Path, study: Study, log: list[tuple[str, int]]
) -> None:
    changes = ['quantities=["statistics", "duplication", "rmse"]']
    table = run_study(load_study(str(tmp_path / "small.toml"), changes), tmp_path / "out")
    keys = [(row.quantity, row.variant) for row in table.rows]
    assert len(keys) == len(set(keys)) == 2 * 5
    assert keys[-2:] == [("RMSE", "plain"), ("RMSE", "better")]
    only = run_study(
        load_study(str(tmp_path / "small.toml"), ['quantities=["duplication"]']), tmp_path / "out"
    )
    assert {row.quantity for row in only.rows} == {"duplicated paths r=8, after mutations"}
    assert only.rows[1].ratio is not None
    assert only.rows[1].ratio.value == 1.0
    assert only.rows[1].p_value == 1.0


def test_the_documentation_has_every_quantity_and_key() -> None:
    text = (Path(__file__).parents[1] / "docs" / "studies.md").read_text("utf-8")
    named = set(re.findall(r"[`\[.]([a-z_]+)[`\].]", text))
    keys = {field.name for field in fields(Study)}
    assert {*QUANTITIES, *keys} <= named


def test_equal_time_by_hand(tmp_path: Path, study: Study, log: list[tuple[str, int]]) -> None:
    changes = ['quantities=["equal_time"]', "warmup=0", "keep='all'"]
    changed = load_study(str(tmp_path / "small.toml"), changes)
    rows = {(r.variant, r.quantity): r for r in run_study(changed, tmp_path / "out").rows}
    folder = StudyFolder(tmp_path / "out", changed)
    reference = reference_module.load_reference(folder, (24, 16))
    assert reference is not None
    error: dict[tuple[str, str], float] = {}
    for name in ("plain", "better"):
        runs = [folder.load_run((24, 16), name, index) for index in range(3)]
        for kind, images in (
            ("last", [run.last for run in runs if run]),
            ("mean", [run.mean for run in runs if run]),
            ("frames", [frame for run in runs if run for frame in run.frames]),
        ):
            errors = [
                relmse(image, reference.image, reference_variance=reference.variance)
                for image in images
            ]
            error[name, kind] = float(np.mean(errors))
    # Every fake frame takes 0.01 s, and a run has 3 frames.
    expected = {
        "last frame at its own time": error["plain", "frames"] / error["better", "last"],
        "last frame charged with all": error["plain", "frames"] / error["better", "last"] / 3,
        "average of all frames": error["plain", "frames"] / error["better", "mean"] / 3,
    }
    for reading, value in expected.items():
        found = rows["better", f"equal time: {reading}"].value
        assert found.value == pytest.approx(value, rel=1e-5)


def test_variants_have_baselines_of_their_own(
    tmp_path: Path, study: Study, log: list[tuple[str, int]]
) -> None:
    file = tmp_path / "small.toml"
    file.write_text(STUDY + '\n[variants.best]\ntype = "path"\nspp = 16\nbaseline = "better"\n')
    rows = {
        (r.variant, r.quantity): r for r in run_study(load_study(str(file)), tmp_path / "out").rows
    }
    means = {name: rows[name, "RMSE"].value.value for name in ("plain", "better", "best")}
    for name, other in (("better", "plain"), ("best", "better")):
        row = rows[name, "RMSE"]
        assert row.ratio is not None
        assert row.ratio.value == pytest.approx(means[name] / means[other])
        assert row.p_value is not None
        assert 0.0 < row.p_value <= 1.0
    # Another baseline is another reading of the same runs.
    log.clear()
    run_study(load_study(str(file), ["variants.best.baseline=plain"]), tmp_path / "out")
    assert log == []
    with pytest.raises(UsageError, match="the baseline 'none' is none of the variants"):
        load_study(str(file), ["variants.best.baseline=none"])


def test_a_smoothed_reference_is_surer() -> None:
    rng = np.random.default_rng(1)
    noise = 0.1 * rng.standard_normal((200, 40, 50, 3))
    variance = np.full((40, 50, 3), 0.01)
    images = [smooth(ReferenceImage(1.0 + e, variance), 3.0) for e in noise]
    inside = np.var([i.image[15:25, 15:35] for i in images], axis=0).mean()
    assert images[0].variance.mean() == pytest.approx(inside, rel=0.15)
    assert np.mean([i.image for i in images]) == pytest.approx(1.0, abs=1e-3)


def test_a_reference_that_is_too_noisy_is_refused(
    tmp_path: Path, study: Study, log: list[tuple[str, int]]
) -> None:
    changes = ["reference.spp=2", "reference.batches=2", 'quantities=["rmse", "time"]']
    table = run_study(load_study(str(tmp_path / "small.toml"), changes), tmp_path / "out")
    assert {row.quantity for row in table.rows} == {"time of a frame"}
    assert len(table.notes) == 1
    assert "RMSE at 24x16 is not given" in table.notes[0]
    assert "the reference's own noise; give the reference 2 times the samples" in table.notes[0]


def test_a_reference_of_unknown_error_is_noted(
    study: Study, tmp_path: Path, log: list[tuple[str, int]]
) -> None:
    file = tmp_path / "truth.exr"
    write_atomically(file, encode_exr(np.ones((16, 24, 3), np.float32)))
    changed = replace(study, reference=Reference(file=str(file)))
    (note,) = run_study(changed, tmp_path / "out").notes
    assert "the error of the reference" in note
    assert "a variance can be given" in note


def test_a_probe_with_another_reference_is_asked_again(
    study: Study, tmp_path: Path, log: list[tuple[str, int]]
) -> None:
    own = StudyFolder(tmp_path / "out", study)
    for probe in ("mutation_spectra", "statistics"):
        own.save_probe((24, 16), "plain", probe, 0, {"number": 1.0})
        assert own.load_probe((24, 16), "plain", probe, 0) == {"number": 1.0}
    own.claim()
    assert study.reference is not None
    surer = replace(study, reference=replace(study.reference, spp=128))
    other = StudyFolder(tmp_path / "out", surer)
    assert other.load_probe((24, 16), "plain", "mutation_spectra", 0) is None
    assert other.load_probe((24, 16), "plain", "statistics", 0) == {"number": 1.0}
    assert "another reference" in other.refused[0]


def test_a_reference_is_rendered_to_a_stated_noise(
    tmp_path: Path, study: Study, log: list[tuple[str, int]]
) -> None:
    """Batches of 4 samples whose noise is 10 %: 16 of them have 2.5 %."""
    file = str(tmp_path / "small.toml")
    changes = ["reference={spp=400, batches=100, noise=0.025}", "runs=2"]
    table = run_study(load_study(file, changes), tmp_path / "one")
    rendered = len([1 for name, _ in log if name == "reference"])
    assert 12 <= rendered <= 22
    assert not table.notes
    used = reference_module.load_reference(
        StudyFolder(tmp_path / "one", load_study(file, changes)), (24, 16)
    )
    assert used is not None
    assert used.samples == 4 * rendered
    expected = _numbers(tmp_path / "one")
    # More batches of another study change nothing here.
    run_study(load_study(file, ["reference={spp=160, batches=40}"]), tmp_path / "two")
    log.clear()
    run_study(load_study(file, changes), tmp_path / "one")
    assert log == []
    assert _numbers(tmp_path / "one") == expected
    # An aim that is out of reach is said.
    changes[0] = "reference={spp=160, batches=40, noise=0.001}"
    table = run_study(load_study(file, changes), tmp_path / "one")
    assert any("not 0.1 %: it needs more batches" in note for note in table.notes)


def test_the_report_states_the_samples_that_were_used(study: Study) -> None:
    assert study.reference is not None
    smooth = replace(study, reference=replace(study.reference, smooth=1.5))
    for changed, samples, expected in (
        (study, {"24x16": 48}, "path, 48 samples per pixel"),
        (study, {"24x16": 48, "8x8": 32}, "path, samples per pixel: 48 at 24x16, 32 at 8x8"),
        (smooth, {"24x16": 48, "8x8": 48}, "path, 48 samples per pixel, smoothed by a Gaussian of"),
    ):
        assert facts(changed, samples)["Reference"].startswith(expected)


def test_references_are_shared_between_studies(
    tmp_path: Path, study: Study, log: list[tuple[str, int]]
) -> None:
    run_study(study, tmp_path / "one")
    assert len([1 for name, _ in log if name == "reference"]) == 4
    log.clear()
    file = str(tmp_path / "small.toml")
    run_study(load_study(file, ["seed=8", "runs=2"]), tmp_path / "two")
    assert "reference" not in {name for name, _ in log}
    # More samples add to what is there; another scene starts anew.
    run_study(load_study(file, ["reference={spp=96, batches=6}"]), tmp_path / "one")
    assert len([1 for name, _ in log if name == "reference"]) == 2
    log.clear()
    run_study(load_study(file, ["scene=cornell"]), tmp_path / "three")
    assert len([1 for name, _ in log if name == "reference"]) == 4


def test_a_scene_is_known_by_its_content(tmp_path: Path, study: Study) -> None:
    (tmp_path / "meshes").mkdir()
    mesh, scene = tmp_path / "meshes" / "a.ply", tmp_path / "scene.xml"
    mesh.write_bytes(b"ply")
    scene.write_text(
        '<scene version="3.0.0"><string name="filename" value="meshes/a.ply"/></scene>'
    )
    changed = load_study(str(tmp_path / "small.toml"), [f"scene={scene}"])
    first = scene_digest(changed)
    assert first != scene_digest(study)
    assert scene_digest(changed) == first
    mesh.write_bytes(b"PLY")
    assert scene_digest(changed) != first


@pytest.mark.parametrize(
    "named",
    [
        "<shape type='ply'><string name='filename' value='meshes/a.ply'/></shape>",
        '<path value="meshes"/><shape type="ply"><string name="filename" value="a.ply"/></shape>',
        '<include filename="part.xml"/>',
    ],
)
def test_every_file_of_a_scene_is_found(named: str, tmp_path: Path, study: Study) -> None:
    (tmp_path / "meshes").mkdir()
    mesh, scene = tmp_path / "meshes" / "a.ply", tmp_path / "scene.xml"
    mesh.write_bytes(b"ply")
    numbers = " ".join(["0.125"] * 100)
    part = f"<scene version='3.0.0'><matrix value='{numbers}'/>{named}</scene>"
    scene.write_text(part)
    # A file that is included names others as seen from the scene.
    (tmp_path / "part.xml").write_text('<scene><string value="meshes/a.ply"/></scene>')
    changed = load_study(str(tmp_path / "small.toml"), [f"scene={scene}"])
    first = scene_digest(changed)
    mesh.write_bytes(b"PLY")
    assert scene_digest(changed) != first


@pytest.mark.parametrize("quantity", ["rmse", "statistics"])
def test_an_edited_scene_is_another_study(
    quantity: str, tmp_path: Path, study: Study, log: list[tuple[str, int]]
) -> None:
    scene, out = tmp_path / "scene.xml", tmp_path / "out"
    scene.write_text('<scene version="3.0.0"/>')
    changes = [f"scene={scene}", f"quantities=['{quantity}']"]
    own = load_study(str(tmp_path / "small.toml"), changes)
    run_study(own, out)
    log.clear()
    run_study(own, out)
    assert log == []
    before = {f: f.read_bytes() for f in out.rglob("*") if f.is_file()}
    scene.write_text('<scene version="3.0.0"><!-- edited --></scene>')
    with pytest.raises(UsageError, match=r"with another content of its scene .*: choose a new"):
        run_study(own, out)
    assert log == []
    assert {f: f.read_bytes() for f in before} == before
    scene.unlink()
    with pytest.raises(UsageError, match="neither a file nor an embedded scene"):
        run_study(own, out)


def test_runs_of_different_software_are_noted(
    tmp_path: Path, study: Study, log: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs_module, "software", lambda: "mitsuba-restir 0.0.1 (12345678)")
    assert not run_study(replace(study, runs=2), tmp_path / "out").notes
    assert not run_study(replace(study, runs=2), tmp_path / "out").notes
    monkeypatch.setattr(runs_module, "software", software)
    (note,) = run_study(study, tmp_path / "out").notes
    assert "24x16" in note
    assert "mitsuba-restir 0.0.1 (12345678)" in note
    assert software() in note


def test_a_worker_with_another_scene_is_refused(study: Study) -> None:
    with pytest.raises(UsageError, match="every worker needs the same files"):
        runs_module.remote_run(study, "another digest", (24, 16), 0, ["plain"])


@pytest.mark.parametrize("stop", [1, 7, 9, 13, 40, 72])
def test_interrupted_studies_end_with_the_same_numbers(
    stop: int,
    study: Study,
    tmp_path: Path,
    log: list[tuple[str, int]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run_study(study, tmp_path / "whole")
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "another cache"))

    def interrupt(done: int, total: int, text: str) -> None:
        assert total == 2 * 3 * 4 + 64
        if done == stop:
            raise KeyboardInterrupt

    out = tmp_path / "parts"
    with pytest.raises(KeyboardInterrupt):
        run_study(study, out, interrupt)
    finished = _files(out)
    log.clear()
    run_study(study, out)
    assert _numbers(out) == _numbers(tmp_path / "whole")
    after = _files(out)
    assert {name: after[name] for name in finished} == finished
    log.clear()
    run_study(study, out)
    assert log == []


@pytest.mark.parametrize("cause", [KeyboardInterrupt(), RuntimeError("[jit.cpp:9] too large")])
def test_what_stops_the_rendering_is_unwrapped(
    cause: BaseException,
    study: Study,
    tmp_path: Path,
    log: list[tuple[str, int]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Dr.Jit names only its own operation, and what stopped it as the cause."""

    def draw(seed: int) -> Any:
        raise RuntimeError("drjit.custom(): error (see above).") from cause

    renderer = Renderer(draw, lambda: None, False)
    monkeypatch.setattr(runner, "make_renderer", lambda *arguments: renderer)
    code = cli.main(["evaluate", str(tmp_path / "small.toml"), "-o", str(tmp_path / "out")])
    interrupted = isinstance(cause, KeyboardInterrupt)
    assert code == (130 if interrupted else 1)
    (line,) = capsys.readouterr().err.splitlines()
    expected = "the same command goes on" if interrupted else "small: rendering failed: too large"
    assert line.endswith(expected)


@pytest.mark.parametrize("damage", ["truncated", "flipped", "empty", "moved", "other study"])
def test_damaged_files_are_not_accepted(
    damage: str, study: Study, tmp_path: Path, log: list[tuple[str, int]]
) -> None:
    out = tmp_path / "out"
    run_study(study, out)
    expected = _numbers(out)
    victim = out / "runs" / "24x16" / "plain" / "0001.npz"
    data = victim.read_bytes()
    if damage == "truncated":
        victim.write_bytes(data[: len(data) // 2])
    elif damage == "flipped":
        with zipfile.ZipFile(victim) as archive:
            # Past the member's own header, whose time stamp nobody reads.
            place = archive.getinfo("last.npy").header_offset + 200
        victim.write_bytes(data[:place] + bytes([data[place] ^ 0xFF]) + data[place + 1 :])
    elif damage == "empty":
        victim.write_bytes(b"")
    elif damage == "moved":
        victim.write_bytes((victim.parent / "0000.npz").read_bytes())
    else:
        other = tmp_path / "other"
        run_study(load_study(str(tmp_path / "small.toml"), ["seed=6"]), other)
        victim.write_bytes((other / victim.relative_to(out)).read_bytes())
    log.clear()
    table = run_study(study, out)
    assert len(table.notes) == 1
    assert "0001.npz is not used" in table.notes[0]
    # Rendered again, that run alone; 3 frames of rehearsal come first.
    assert [name for name, _ in log] == ["plain"] * (3 + 3)
    assert _numbers(out) == expected


def test_no_flipped_byte_is_accepted(tmp_path: Path) -> None:
    """Every byte of a file in turn, the directory at its end included."""
    file = tmp_path / "run.npz"
    whole = {"mean": np.ones((1, 1, 3), dtype=np.float32), "times": np.array([0.5])}
    save_arrays(file, {"digest": "d"}, {**whole, "frames": np.ones(2)})
    data = file.read_bytes()
    accepted = 0
    for place, byte in enumerate(data):
        file.write_bytes(data[:place] + bytes([byte ^ 0x55]) + data[place + 1 :])
        try:
            label, arrays = load_arrays(file)
        except ValueError:
            continue
        # Nobody reads the time stamps and attributes of a ZIP file.
        accepted += 1
        assert label == {"digest": "d"}
        assert {name: array.tolist() for name, array in arrays.items()} == {
            name: array.tolist() for name, array in {**whole, "frames": np.ones(2)}.items()
        }
    assert accepted < len(data) / 4


def test_a_lost_array_is_damage(tmp_path: Path) -> None:
    file = tmp_path / "run.npz"
    save_arrays(file, {"digest": "d"}, {"mean": np.ones(3), "frames": np.ones(2)})
    with np.load(file) as stored:
        arrays = {name: stored[name] for name in ("label", "mean")}
    np.savez(file, **arrays)
    with pytest.raises(ValueError, match=r"its arrays are mean, not frames, mean"):
        load_arrays(file)


def test_other_settings_are_refused(
    study: Study, tmp_path: Path, log: list[tuple[str, int]]
) -> None:
    out, file = tmp_path / "out", str(tmp_path / "small.toml")
    run_study(study, out)
    before = _files(out)
    with pytest.raises(UsageError, match=r"seed, variants differ"):
        run_study(load_study(file, ["seed=6", "variants.better.spp=2"]), out)
    assert _files(out) == before
    assert load_study(str(out / "config.toml")) == study
    # More runs and other quantities leave finished runs as they are.
    log.clear()
    run_study(load_study(file, ["runs=4", 'quantities=["smape"]']), out)
    assert len([1 for name, _ in log if name == "plain"]) == 3 + 3
    after = _files(out)
    assert {name: after[name] for name in before} == before


def test_variants_can_be_added(study: Study, tmp_path: Path, log: list[tuple[str, int]]) -> None:
    out, file = tmp_path / "out", tmp_path / "small.toml"
    run_study(study, out)
    before = _files(out)
    log.clear()
    file.write_text(STUDY + '\n[variants.best]\ntype = "path"\nspp = 16\n')
    more = load_study(str(file))
    table = run_study(more, out)
    assert {name for name, _ in log} == {"best"}
    after = _files(out)
    assert {name: after[name] for name in before} == before
    run_study(more, tmp_path / "whole")
    assert _numbers(out) == _numbers(tmp_path / "whole")
    # Times are compared only where the variants took turns.
    ratios = {row.variant: row.ratio for row in table.rows if row.quantity == "time of a frame"}
    assert ratios["better"] is not None
    assert ratios["best"] is None
    # Back to fewer, and to the same again: nothing is rendered twice.
    log.clear()
    run_study(study, out)
    run_study(more, out)
    assert log == []
    # Left out and then made otherwise, it is another variant of the same name.
    run_study(study, out)
    table = run_study(load_study(str(file), ["variants.best.spp=9"]), out)
    assert {name for name, _ in log} == {"best"}
    assert all("best" in note and "another study" in note for note in table.notes)
    assert len(table.notes) == 3
    with pytest.raises(UsageError, match="variants differ"):
        run_study(load_study(str(file), ["variants.best.spp=25"]), out)


def test_a_lost_history_costs_time_and_nothing_else(
    study: Study, tmp_path: Path, log: list[tuple[str, int]]
) -> None:
    out, file = tmp_path / "out", tmp_path / "small.toml"
    run_study(study, out)
    file.write_text(STUDY + '\n[variants.best]\ntype = "path"\nspp = 16\n')
    more = load_study(str(file))
    run_study(more, out)
    expected = _numbers(out)
    (out / "studies.json").write_text("[1")
    log.clear()
    table = run_study(more, out)
    assert len(table.notes) == 2 * 3
    assert {name for name, _ in log} == {"plain", "better"}
    assert _numbers(out) == expected


def test_a_folder_that_was_only_begun_is_used(
    study: Study, tmp_path: Path, log: list[tuple[str, int]]
) -> None:
    """What is there when the first or the second file is half written."""
    out = tmp_path / "out"
    out.mkdir()
    for name in (".lock", "studies.json", ".studies.json.a.partial", ".config.toml.b.partial"):
        (out / name).write_text("[1")
    run_study(study, out)
    assert not list(out.rglob(".*.partial"))


def test_leftovers_in_the_cache_are_removed(
    study: Study, tmp_path: Path, log: list[tuple[str, int]]
) -> None:
    folder = cache.cache_folder("references") / "other"
    folder.mkdir(parents=True)
    old, new = folder / ".0001.npz.a.partial", folder / ".0001.npz.b.partial"
    for file in (old, new):
        file.write_bytes(b"half")
    yesterday = time.time() - 86400.0
    os.utime(old, (yesterday, yesterday))
    run_study(study, tmp_path / "out")
    # Another process may be writing the new one.
    assert list(folder.iterdir()) == [new]


def test_a_folder_with_other_things_is_left_alone(study: Study, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match="holds no study"):
        run_study(study, tmp_path)
    with pytest.raises(UsageError, match=r"cannot make|holds no study"):
        run_study(study, tmp_path / "notes.txt" / "out")


def test_a_full_disk_is_one_line_and_loses_nothing(
    study: Study,
    tmp_path: Path,
    log: list[tuple[str, int]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refuse(monkeypatch, "0001.npz")
    with pytest.raises(RenderError, match="No space left on device"):
        run_study(study, tmp_path / "out")
    monkeypatch.undo()
    assert list(_files(tmp_path / "out")) == [
        "runs/24x16/better/0000.npz",
        "runs/24x16/plain/0000.npz",
    ]
    assert not list((tmp_path / "out").rglob("*.partial"))


def test_an_image_with_nan_is_named(
    study: Study, tmp_path: Path, log: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    make = _fake(log)

    def broken(*arguments: Any) -> Renderer:
        renderer = make(*arguments)

        class Broken(Renderer):
            def frame(self, seed: int) -> tuple[Any, float]:
                image, seconds = renderer.frame(seed)
                image[0, 0] = np.nan
                return image, seconds

        return Broken(renderer.draw, renderer.reset, renderer.has_history)

    monkeypatch.setattr(runner, "make_renderer", broken)
    with pytest.raises(RenderError, match=r"small at 24x16 cannot be measured.*NaN"):
        run_study(study, tmp_path / "out")


def test_reference_files_must_fit(study: Study, tmp_path: Path) -> None:
    file = str(tmp_path / "small.toml")
    table = to_table(study)
    table["reference"] = {"file": str(tmp_path / "none.exr")}
    with pytest.raises(UsageError, match=r"none\.exr"):
        run_study(from_table(table, file), tmp_path / "out")
    assert not (tmp_path / "out").exists()
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("llvm_ad_rgb")
    mi.Bitmap(np.ones((8, 8, 3), dtype=np.float32)).write(str(tmp_path / "small.exr"))
    table["reference"] = {"file": str(tmp_path / "small.exr")}
    with pytest.raises(UsageError, match="has 8x8 pixels, the study 24x16"):
        run_study(from_table(table, file), tmp_path / "out")


REAL = """
name = "real"
scene = "cornell"
sizes = ["16x12"]
max_depth = 3
frames = 2
runs = 2
quantities = ["relmse", "equal_time", "time"]

[reference]
spp = 32
batches = 2

[variants.path]
type = "path"

[variants.path4]
type = "path"
spp = 4
"""


@pytest.mark.slow
def test_variants_that_cannot_be_made_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "real.toml"
    file.write_text(REAL.replace('type = "path"', 'type = "pth"', 1))
    with pytest.raises(UsageError, match="variant 'path'"):
        run_study(load_study(str(file)), tmp_path / "out")
    file.write_text(REAL.replace('type = "path"', 'type = "path"\nmax_dpeth = 3', 1))
    with pytest.raises(UsageError, match=r"variant 'path'.*max_dpeth"):
        run_study(load_study(str(file)), tmp_path / "out")
    assert not (tmp_path / "out").exists()
