"""Studies: frames that are far apart, variants made of others, and lights that move."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import ndimage
from support.studies import study_of

import mitsuba_restir.studies.runner as runner
import mitsuba_restir.studies.store.reference as reference_module
from mitsuba_restir.errors import UsageError
from mitsuba_restir.studies import Study, run_study
from mitsuba_restir.studies.config.adapt import without
from mitsuba_restir.studies.measure.derived import with_derived
from mitsuba_restir.studies.measure.frame_errors import filtered_mse, frames_of
from mitsuba_restir.studies.measure.results import Measured
from mitsuba_restir.studies.runs.rendering import Renderer, make_renderer
from mitsuba_restir.studies.runs.results import ReferenceImage, Run
from mitsuba_restir.studies.runs.scene import load_scene
from mitsuba_restir.studies.store.folder import StudyFolder

STUDY = """
name = "frames"
scene = "cornell"
sizes = ["24x16"]
max_depth = 3
frames = 3
warmup = 2
stride = 4
runs = 2
keep = "all"
quantities = ["relmse"]

[reference]
spp = 64
batches = 4

[variants.path]
type = "path"

[variants.restir]
type = "restir_pt"
"""

BLUR = """
[variants.blurred]
of = "path"
blur_to = "restir"
baseline = "path"
"""


pytestmark = pytest.mark.usefixtures("own_cache")


def test_measured_frames_are_a_stride_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: dict[str, int] = {"path": 0, "restir": 0, "reference": 0}

    def make(study: Study, scene: Any, size: Any, name: str, variant: Any) -> Renderer:
        class Fake(Renderer):
            def frame(self, seed: int) -> tuple[Any, float]:
                drawn[name] += 1
                return np.full((16, 24, 3), 1.0 + drawn[name], dtype=np.float32), 0.01

        return Fake(lambda seed: None, lambda: None, name == "restir")

    monkeypatch.setattr(runner, "load_scene", lambda study: None)
    monkeypatch.setattr(runner, "make_renderer", make)
    monkeypatch.setattr(reference_module, "make_renderer", make)
    study = study_of(tmp_path, STUDY)
    assert study.length == 2 + 2 * 4 + 1
    total = 0

    def progress(done: int, units: int, text: str) -> None:
        nonlocal total
        total = units

    run_study(study, tmp_path / "out", progress)
    assert total == 2 * 2 * 11 + 64
    # What has no history is only rendered where it is measured; 3 frames of rehearsal each.
    assert drawn == {"path": 3 + 2 * 3, "restir": 3 + 2 * 11, "reference": 4}
    run = StudyFolder(tmp_path / "out", study).load_run((24, 16), "restir", 0)
    assert run is not None
    frames = run.frames
    assert frames is not None
    levels = frames[:, 0, 0, 0]
    np.testing.assert_array_equal(levels, 4.0 + np.array([3, 7, 11]))
    assert run.last[0, 0, 0] == levels[-1]
    assert run.mean[0, 0, 0] == pytest.approx(levels.mean())


def test_frames_count_once_the_history_has_settled() -> None:
    frames = np.arange(4.0, dtype=np.float32)[:, None, None, None] * np.ones((1, 2, 2, 3), "f4")
    run = Run(frames[-1], frames.mean(axis=0), np.zeros(4), lambda: frames)
    cold = Measured("2x2", {"a": [run]}, "a", {}, None, 0.01, 0.0)
    settled = Measured("2x2", {"a": [run]}, "a", {}, None, 0.01, 0.0, settled=True)
    assert len(frames_of(cold, run)) == 1
    assert frames_of(cold, run)[0, 0, 0, 0] == 3.0
    assert len(frames_of(settled, run)) == 4


def _measured(noise: float, better: float, width: float) -> Measured:
    """Two variants of white noise about a ramp and the reference; `restir` is blurred noise."""
    rng = np.random.default_rng(3)
    truth = np.linspace(0.8, 1.2, 96)[None, :, None] * np.ones((64, 1, 3))

    def runs(spread: float, sigma: float) -> list[Run]:
        found = []
        for _ in range(3):
            error = spread * rng.standard_normal((2, 64, 96, 1))
            seen = ndimage.gaussian_filter(error, (0, sigma, sigma, 0), mode="wrap")
            frames = (truth + seen).astype(np.float32)
            mean = frames.mean(axis=0)
            found.append(Run(frames[-1], mean, np.ones(2), partial(np.asarray, frames)))
        return found

    reference = ReferenceImage(truth, np.zeros_like(truth))
    both = {"path": runs(noise, 0.0), "restir": runs(better, width)}
    return Measured("96x64", both, "path", {}, reference, 0.01, 0.0, settled=True)


def test_a_blur_of_equal_filtered_error(tmp_path: Path) -> None:
    study = study_of(tmp_path, STUDY + BLUR)
    # White noise through a Gaussian of 1.2 pixels: that is the width to be found again.
    data = with_derived(study, _measured(0.5, 0.5, 1.2))
    assert data.notes == ()
    assert data.blurs["blurred"] == pytest.approx(1.2, abs=0.1)
    reference = data.reference
    assert reference is not None
    means = {
        name: np.mean([filtered_mse(frames_of(data, run), reference) for run in runs])
        for name, runs in data.runs.items()
    }
    assert means["blurred"] == pytest.approx(means["restir"], rel=0.02)
    assert data.runs["blurred"][0].times.size == 0
    frames = data.runs["blurred"][0].frames
    assert frames is not None
    np.testing.assert_allclose(frames[-1], data.runs["blurred"][0].last, atol=1e-6)
    np.testing.assert_allclose(frames.mean(axis=0), data.runs["blurred"][0].mean, atol=1e-6)


def test_fireflies_do_not_spoil_a_blur(tmp_path: Path) -> None:
    """They are clipped where errors are measured, and must not be spread before that."""
    study = study_of(tmp_path, STUDY + BLUR)
    measured = _measured(0.5, 0.5, 1.2)
    lit = {name: [_with_firefly(run) for run in runs] for name, runs in measured.runs.items()}
    data = with_derived(study, replace(measured, runs=lit))
    assert data.notes == ()
    assert data.blurs["blurred"] == pytest.approx(1.2, abs=0.15)


def _with_firefly(run: Run) -> Run:
    assert run.frames is not None
    frames = run.frames.copy()
    frames[:, 30, 40] = 300.0
    return Run(frames[-1], frames.mean(axis=0), run.times, partial(np.asarray, frames))


def test_a_blur_that_cannot_reach_the_goal_is_the_best_one(tmp_path: Path) -> None:
    study = study_of(tmp_path, STUDY + BLUR)
    measured = _measured(0.5, 0.001, 0.0)
    # A grating, which a wide blur takes away.
    reference = measured.reference
    assert reference is not None
    grating = 0.3 * np.sin(np.arange(96) / 3.0)[None, :, None]
    moved = {
        name: [
            Run(r.last + grating, r.mean + grating, r.times, partial(_moved, r, grating))
            for r in runs
        ]
        for name, runs in measured.runs.items()
    }
    truth = ReferenceImage(reference.image + grating, reference.variance)
    data = with_derived(study, replace(measured, runs=moved, reference=truth))
    (note,) = data.notes
    assert "'blurred' at 96x64: no Gaussian brings the filtered MSE of 'path' down to" in note
    errors = {
        sigma: np.mean(
            [
                filtered_mse(ndimage.gaussian_filter(r.frames, (0, sigma, sigma, 0)), truth)
                for r in data.runs["path"]
            ]
        )
        for sigma in (0.5 * data.blurs["blurred"], data.blurs["blurred"], 2 * data.blurs["blurred"])
    }
    assert min(errors, key=lambda sigma: errors[sigma]) == data.blurs["blurred"]
    already = with_derived(study, _measured(0.1, 0.5, 0.0))
    assert already.blurs["blurred"] == 0.0
    assert already.notes == ()


def _moved(run: Run, by: np.ndarray) -> np.ndarray:
    assert run.load_frames is not None
    return run.load_frames() + by


def test_a_study_with_a_blur_runs_to_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def make(study: Study, scene: Any, size: Any, name: str, variant: Any) -> Renderer:
        class Fake(Renderer):
            def frame(self, seed: int) -> tuple[Any, float]:
                noise = np.random.default_rng(seed).standard_normal((16, 24, 1))
                seen = ndimage.gaussian_filter(noise, (1.0, 1.0, 0)) if name == "restir" else noise
                level = 0.01 if name == "reference" else 0.2
                return (1.0 + level * seen * np.ones(3)).astype(np.float32), 0.01

        return Fake(lambda seed: None, lambda: None, name == "restir")

    monkeypatch.setattr(runner, "load_scene", lambda study: None)
    monkeypatch.setattr(runner, "make_renderer", make)
    monkeypatch.setattr(reference_module, "make_renderer", make)
    quantities = "quantities=['relmse', 'time', 'speed', 'covariance', 'filtered_mse']"
    study = study_of(tmp_path, STUDY + BLUR, quantities)
    table = run_study(study, tmp_path / "out")
    rows = {(row.variant, row.quantity): row for row in table.rows}
    assert rows["blurred", "Gaussian of the blur"].value.value == pytest.approx(1.0, abs=0.3)
    assert rows["blurred", "relMSE"].ratio is not None
    # Nothing was rendered, so there is no time.
    assert ("blurred", "time of a frame") not in rows
    assert ("path", "time of a frame") in rows


def test_what_is_made_of_others_renders_nothing(tmp_path: Path) -> None:
    plain, more = study_of(tmp_path, STUDY), study_of(tmp_path, STUDY + BLUR)
    assert more.rendered() == ["path", "restir"]
    # A control can be added to a study that has been rendered.
    assert StudyFolder(tmp_path / "a", plain).digest == StudyFolder(tmp_path / "b", more).digest
    with pytest.raises(UsageError, match="'blurred' is made of 'restir': leave it out as well"):
        without(more, ["restir"])
    with pytest.raises(UsageError, match="'blurred' is made of 'none', which is no rendered"):
        study_of(tmp_path, STUDY + BLUR, "variants.blurred.of=none")
    with pytest.raises(UsageError, match=r"unknown key 'type'.*of, blur_to"):
        study_of(tmp_path, STUDY + BLUR, "variants.blurred.type=path")


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        ("", "give a step of the camera, a light"),
        (
            "step = [0, 0, 1]\ncut_from = { fov = 9, origin = [0, 0, 1], target = [0, 0, 0] }",
            "alone",
        ),
        ('light = "light.to_world"', "light and light_step go together"),
        ("light_step = [0, 0, 1]", "a light and its step"),
        ("step = [0, 1]", "step must be three finite numbers"),
    ],
)
def test_motions_that_make_no_sense(motion: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=message):
        study_of(tmp_path, f"{STUDY}\n[motion]\n{motion}\n", "frames=1")


MOVING = """
name = "moving"
scene = "cornell"
sizes = ["24x16"]
max_depth = 3
frames = 1
warmup = 6
runs = 16
quantities = ["mean_ratio"]

[motion]
light = "light.to_world"
light_step = [0.05, 0.0, 0.0]

[reference]
spp = 2048
batches = 16

[variants.path]
type = "path"

[variants.restir]
type = "restir_pt"
retrace_history = true
"""


@pytest.mark.slow
def test_a_moving_light_arrives_where_the_reference_has_it(tmp_path: Path) -> None:
    study = study_of(tmp_path, MOVING)
    table = run_study(study, tmp_path / "out")
    for row in table.rows:
        if row.quantity == "mean ratio":
            assert abs(row.value.value - 1.0) < 4.0 * row.value.standard_error + 0.01
    folder = StudyFolder(tmp_path / "out", study)
    batches = [folder.load_batch((24, 16), index) for index in range(16)]
    truth = np.mean([batch for batch in batches if batch is not None], axis=0)
    for name in study.variants:
        runs = [folder.load_run((24, 16), name, index) for index in range(study.runs)]
        images = np.stack([run.last for run in runs if run is not None])
        # Left and right are as bright as with the lamp at its place, not where it came from.
        for half in (slice(12), slice(12, 24)):
            sides = images[:, :, half].mean(axis=(1, 2, 3)) / truth[:, half].mean()
            error = sides.std(ddof=1) / np.sqrt(study.runs)
            assert abs(sides.mean() - 1.0) < 4.0 * error
    with pytest.raises(
        UsageError,
        match=r"light = 'lamp\.x' is no transform of the scene; there are .*light\.to_world",
    ):
        run_study(study_of(tmp_path, MOVING, "motion.light='lamp.x'"), tmp_path / "other")


@pytest.mark.slow
def test_a_light_moves_and_comes_back(tmp_path: Path) -> None:
    study = study_of(tmp_path, MOVING, "motion.light_step=[0.1,0,0]")
    scene = load_scene(study)
    renderers = [
        make_renderer(study, scene, (24, 16), name, study.variants[name])
        for name in ("path", "path")
    ]
    images = [
        renderer.frame_before_last(1, frames)[0] for frames in (0, 6, 0) for renderer in renderers
    ]
    np.testing.assert_array_equal(images[0::2], images[1::2])
    np.testing.assert_array_equal(images[0], images[4])
    # 0.6 to the left, the lamp lights the left wall more and the right one less.
    left, right = (images[2][:, half].mean() for half in (slice(4), slice(20, 24)))
    assert left / right > 1.5 * images[0][:, :4].mean() / images[0][:, 20:].mean()


@pytest.mark.slow
def test_a_cut_ends_where_the_reference_is(tmp_path: Path) -> None:
    """After a cut the camera is the study's own; before it, what only the other one sees."""
    cut = (
        "motion.light=''", "motion.light_step=[0,0,0]", "frames=3", "warmup=2",
        "motion.cut_from={fov=40, origin=[0,0,0.5], target=[-1,0,0.5]}",
    )  # fmt: skip
    study, still = study_of(tmp_path, MOVING, *cut), study_of(tmp_path, STUDY, "max_depth=3")
    scene = load_scene(study)
    moved = make_renderer(study, scene, (24, 16), "path", study.variants["path"])
    fixed = make_renderer(still, scene, (24, 16), "path", study.variants["path"])
    before, *after = (moved.frame_before_last(1, frames)[0] for frames in (3, 2, 0))
    wanted = fixed.frame(1)[0]
    for image in after:
        np.testing.assert_allclose(image, wanted, rtol=1e-3, atol=1e-4)
    assert np.abs(before - wanted).mean() > 0.1 * wanted.mean()


@pytest.mark.slow
def test_a_crop_is_a_part_of_the_whole(tmp_path: Path) -> None:
    """The right lower quarter, pixel by pixel: means of many samples at the same places."""
    text = STUDY.replace("[variants.path]\n", "[variants.path]\nspp = 256\n", 1)
    whole = study_of(tmp_path, text)
    crop = study_of(tmp_path, text, "crop=[0.5, 0.5, 0.5, 0.5]", "sizes=['12x8']")
    images = []
    for study in (whole, crop):
        renderer = make_renderer(
            study, load_scene(study), study.sizes[0], "path", study.variants["path"]
        )
        images.append(np.mean([renderer.frame(seed)[0] for seed in range(8)], axis=0))
    assert images[1].shape == (8, 12, 3)
    np.testing.assert_allclose(images[1], images[0][8:, 12:], rtol=0.15, atol=0.02)
    # Reuse over time finds its history in a crop, too (but for edges, of which there are many).
    restir = make_renderer(crop, load_scene(crop), (12, 8), "restir", crop.variants["restir"])
    for seed in range(3):
        restir.frame(seed)
    assert restir.statistics is not None
    assert restir.statistics()["matched"] > 0.6


@pytest.mark.slow
def test_an_auxiliary_image_can_be_shown(tmp_path: Path) -> None:
    text = STUDY + '\n[variants.shown]\ntype = "restir_pt"\nshows = "albedo"\n'
    study = study_of(tmp_path, text)
    scene = load_scene(study)
    renderers = {
        name: make_renderer(study, scene, (24, 16), name, study.variants[name])
        for name in ("restir", "shown")
    }
    images = {name: renderer.frame(1)[0] for name, renderer in renderers.items()}
    assert images["shown"].shape == images["restir"].shape == (16, 24, 3)
    # The floor's albedo, whatever light falls on it; the lamp has none.
    np.testing.assert_allclose(images["shown"][-1, 12], [0.73, 0.71, 0.68], atol=1e-3)
    assert np.abs(images["restir"] - images["shown"]).max() > 0.1
    for kind, message in (("depth", "it has 1 channels, not 3"), ("dephts", "variant 'shown'")):
        wrong = study_of(tmp_path, text.replace('"albedo"', f'"{kind}"'))
        with pytest.raises(UsageError, match=message):
            make_renderer(wrong, scene, (24, 16), "shown", wrong.variants["shown"])
