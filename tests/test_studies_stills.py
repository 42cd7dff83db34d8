"""Studies of stills: as variants, and what they are worth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.studies import study_of

from mitsuba_restir.errors import UsageError
from mitsuba_restir.still.frames import Frames
from mitsuba_restir.studies import run_study
from mitsuba_restir.studies.measure import previews
from mitsuba_restir.studies.measure.quantities import QUANTITIES
from mitsuba_restir.studies.measure.results import Measured, Refused, Row
from mitsuba_restir.studies.measure.stills import as_long
from mitsuba_restir.studies.runs.probing import SIGMA, previewed_frames, stills_of
from mitsuba_restir.studies.runs.results import ReferenceImage, Run
from mitsuba_restir.studies.store.folder import StudyFolder

STUDY = """
name = "pictures"
scene = "cornell"
sizes = ["24x16"]
max_depth = 3
runs = 3
baseline = "path"
freeze = false
quantities = ["efficiency", "stated", "time"]

[reference]
spp = 64
batches = 4

[variants.path]
type = "path"
spp = 16

[variants.still]
type = "still"
frames = 4
plan = "light"
"""

DENOISED = """
[variants.path_4]
type = "path"
spp = 4
denoise = true

[variants.path_256]
type = "path"
spp = 256
denoise = true

[variants.clean]
type = "still"
frames = 4
denoise = true
"""

SHAPE = (40, 60, 3)


pytestmark = pytest.mark.usefixtures("own_cache")


def _data(
    deviation: float, seconds: float, stated: float = 0.0, runs: int = 12, level: float = 2.0
) -> Measured:
    """Pictures of a level: `path` deviates by 1 in 1 s, the still as it is said."""
    rng = np.random.default_rng(3)

    def pictures(deviation: float, seconds: float, stated: float) -> list[Run]:
        images = (level + rng.normal(0.0, deviation, (runs, *SHAPE))).astype(np.float32)
        said = np.full((1, 2), stated) if stated else None
        return [Run(image, image, np.array([seconds]), stated=said) for image in images]

    made = {"path": pictures(1.0, 1.0, 0.0), "still": pictures(deviation, seconds, stated)}
    truth = ReferenceImage(np.full(SHAPE, level), np.zeros(SHAPE))
    return Measured("60x40", made, "path", dict.fromkeys(made, "path"), truth, 0.01, 0.001)


def _rows(name: str, data: Measured) -> dict[str, Row]:
    return {row.quantity: row for row in QUANTITIES[name].rows(data) if isinstance(row, Row)}


def test_efficiency_is_variance_times_time_of_path_over_ones_own() -> None:
    rows = _rows("efficiency", _data(0.5, 0.25))
    assert {row.variant for row in rows.values()} == {"still"}
    for name, row in rows.items():
        # A median over pixels of variances of few runs is as far off for both.
        assert row.value.value == pytest.approx(16.0, rel=0.03), name
        assert row.value.low < 16.0 < row.value.high


@pytest.mark.parametrize("factor", [1.0, 0.7])
def test_a_stated_error_is_held_against_the_spread(factor: float) -> None:
    rows = _rows("stated", _data(0.5, 1.0, stated=factor * 0.25))
    assert rows["stated over true error, untrimmed"].value.value == pytest.approx(factor, rel=0.02)


def test_as_long_between_and_beyond() -> None:
    curve = np.array([[1.0, 4.0], [4.0, 2.0], [16.0, 1.0]])
    assert as_long(curve, 2.0) == pytest.approx(4.0)
    assert as_long(curve, np.sqrt(2.0)) == pytest.approx(8.0)
    assert as_long(curve, 0.5) == pytest.approx(64.0)
    assert as_long(curve[::-1], 8.0) == pytest.approx(0.25)
    assert np.isnan(as_long(np.array([[1.0, 2.0], [2.0, 2.0]]), 1.0))
    # An error from which the reference's noise was subtracted may be negative.
    assert np.isnan(as_long(curve, -0.1))


@pytest.mark.slow
def test_stills_as_variants(tmp_path: Path) -> None:
    for package in ("mitsuba_oidn", "flip_evaluator"):
        pytest.importorskip(package)
    study = study_of(tmp_path, STUDY)
    table = run_study(study, tmp_path / "out")
    found = {row.quantity: row.value.value for row in table.rows if row.variant == "still"}
    assert found["efficiency, trimmed"] > 0.0
    assert 0.5 < found["stated over true error"] < 2.0
    assert any("light: 9 trees a pixel" in note and "asked for" in note for note in table.notes)
    run = StudyFolder(tmp_path / "out", study).load_run((24, 16), "still", 0)
    assert run is not None
    assert run.stated is not None
    assert run.stated.shape == (1, 2)
    assert "4 frames" in run.remark

    stills = 'reference={"seconds"=2.0, "batches"=2}'
    study = study_of(tmp_path, STUDY + DENOISED, 'quantities=["as_long"]', stills)
    rows = run_study(study, tmp_path / "out").rows
    assert {row.variant for row in rows} == {"clean"}
    assert all(row.value.value > 0.0 for row in rows)


# ------------------------------ previews --------------------------------------------------------


def _erring(deviation: float, seed: int, level: float = 2.0) -> np.ndarray:
    """A grey image of a level whose pixels deviate from it independently."""
    grey = level + np.random.default_rng(seed).normal(0.0, deviation, (256, 256, 1))
    return np.repeat(grey, 3, axis=2).astype(np.float32)


def _known(deviation: float) -> ReferenceImage:
    """A reference whose noise is known."""
    image = _erring(deviation, 0).astype(np.float64)
    return ReferenceImage(image, np.full(image.shape, deviation**2))


def test_a_preview_that_is_the_mean_is_no_gain() -> None:
    pytest.importorskip("flip_evaluator")
    mean = _erring(0.4, 1)
    found = previews.ratios(mean, mean, _known(0.2), 1)
    numbers = previews.NUMBERS[1]
    assert {number.name for number in numbers} < found.keys()
    assert all(found[number.name] == pytest.approx(1.0) for number in numbers)


def test_the_noise_of_the_reference_is_no_error_of_previews() -> None:
    """Half of the mean's error is a quarter of its power: with the reference's noise, 0.4."""
    pytest.importorskip("flip_evaluator")
    mean, shown = _erring(0.4, 1), np.float32(1.01) * _erring(0.2, 2)
    found = previews.ratios(mean, shown, _known(0.2), 4)
    # Of 5000 frequencies in this band, a power is known to 1.4 %.
    assert found[previews.named("power 0.06-0.17", 4)] == pytest.approx(0.25, abs=0.02)
    assert found[previews.named("mean", 4)] == pytest.approx(1.01, abs=5e-3)
    assert found[previews.named("HDR-FLIP", 4)] < 1.0
    (share,) = found.keys() - {number.name for number in previews.NUMBERS[4]}
    assert found[share] == pytest.approx(0.2, rel=0.15)


def test_previews_are_refused_where_the_reference_is_noisier() -> None:
    """After 16 frames, when the errors have fallen below its noise; what is asked for else is
    given, and nothing else."""
    pytest.importorskip("flip_evaluator")
    said = {
        count: previews.ratios(_erring(error, 1), _erring(error, 2), _known(0.2), count)
        for count, error in ((1, 0.4), (16, 0.1))
    }
    data = replace(_data(0.5, 1.0), probes={("still", previews.PROBE): [said[1] | said[16]]})
    *rows, refused = QUANTITIES["previews"].rows(data)
    assert isinstance(refused, Refused)
    assert "previews, 16 frames" in refused.reason
    names = [row.quantity for row in rows if isinstance(row, Row)]
    assert names == [number.name for number in previews.NUMBERS[1]]
    asked = previews.NUMBERS[1][:1]
    (row,) = previews.gains(data, asked)
    assert isinstance(row, Row)
    assert row.quantity == asked[0].name


PREVIEWS = ('quantities=["previews"]', 'sizes=["64x48"]', "probe_runs=1")


def test_previews_become_rows(tmp_path: Path) -> None:
    pytest.importorskip("flip_evaluator")
    study = study_of(
        tmp_path, STUDY, *PREVIEWS, 'variants.still.plan="spp=1"', "reference.spp=1024"
    )
    table = run_study(study, tmp_path / "out")
    found = {row.quantity: row.value.value for row in table.rows}
    # The variant's four frames; a picture of `path` has no previews.
    assert {row.variant for row in table.rows} == {"still"}
    assert list(found) == [n.name for count in (1, 4) for n in previews.NUMBERS[count]]
    assert found[previews.named("mean", 4)] == pytest.approx(1.0, rel=1e-4)
    assert found[previews.named("power 0.06-0.17", 4)] < 1.0


def test_previews_are_those_of_the_variant(tmp_path: Path) -> None:
    """All that it asks of a still holds for the still that is previewed."""
    pytest.importorskip("mitsuba_oidn")
    own = (
        "{type='still', plan='spp=1', max_depth=2, hide_emitters=true, guiding=true, denoise=true}"
    )
    study = study_of(tmp_path, STUDY, f"variants.still={own}")
    source = stills_of(study, (24, 16), "still").begun(7, SIGMA).source
    assert isinstance(source, Frames)
    assert source.subject.parameters == {"max_depth": 2, "hide_emitters": True, "guiding": True}
    assert source.subject.seed == 7
    assert source.subject.guides
    assert source.subject.previewed == SIGMA
    assert source.plan.parameters["guiding"]
    assert source.preview() is not None
    assert not list(previewed_frames(study, (24, 16), "path", 0, previews.COUNTS))


def test_without_flip_one_line_says_so_before_anything_is_rendered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(UsageError, match="'previews' needs pip install flip-evaluator"):
        run_study(study_of(tmp_path, STUDY, *PREVIEWS), tmp_path / "out")
    assert not (tmp_path / "out" / "probes").exists()


# ------------------------------ what is refused -------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("variants.still.plan=no_such_plan", "no_such_plan"),
        ("variants.still.error=0.1", "one of error, seconds and frames"),
        ("variants.still.temporal=true", "a still cannot have temporal=True"),
        ('quantities=["as_long"]', "needs two variants of type path, and another one"),
        ('variants.still={type="path"}', "needs a variant of type still"),
        ("runs=2", "needs at least 3 runs"),
    ],
)
def test_what_cannot_be_measured_gets_one_line(tmp_path: Path, change: str, message: str) -> None:
    with pytest.raises(UsageError, match=message) as refused:
        run_study(study_of(tmp_path, STUDY, change), tmp_path / "out")
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "out" / "runs").exists()
