"""Quantities of studies on images of known noise and known bias."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy import ndimage

from mitsuba_restir.analysis import spectrum
from mitsuba_restir.analysis.covariance import run_products
from mitsuba_restir.analysis.images import smoothed_reference
from mitsuba_restir.studies.measure import errors
from mitsuba_restir.studies.measure.frame_errors import (
    filtered_mse,
    reference_noise,
    relative_errors,
)
from mitsuba_restir.studies.measure.mutation_spectra import SHARE
from mitsuba_restir.studies.measure.quantities import QUANTITIES
from mitsuba_restir.studies.measure.results import Measured, Refused, Row
from mitsuba_restir.studies.runs.reference import smooth
from mitsuba_restir.studies.runs.results import ReferenceImage, Run

SHAPE = (64, 96)


def _run(frames: np.ndarray) -> Run:
    kept = frames.astype(np.float32)
    return Run(kept[-1], kept.mean(axis=0), np.ones(len(kept)), partial(np.asarray, kept))


def _data(images: dict[str, np.ndarray], reference: ReferenceImage) -> Measured:
    """Variants by name, (runs, frames, H, W, 3) each; the first is the baseline of all."""
    runs = {name: [_run(frames) for frames in values] for name, values in images.items()}
    first = next(iter(images))
    baselines = dict.fromkeys(images, first)
    height, width = reference.image.shape[:2]
    return Measured(f"{width}x{height}", runs, first, baselines, reference, 0.01, 0.0, settled=True)


def _rows(name: str, data: Measured) -> dict[tuple[str, str], Row]:
    return {
        (row.variant, row.quantity): row
        for row in QUANTITIES[name].rows(data)
        if isinstance(row, Row)
    }


def _grey(values: np.ndarray) -> np.ndarray:
    return values[..., None] * np.ones(3)


def _exact(level: float = 1.0) -> ReferenceImage:
    image = np.full((*SHAPE, 3), level)
    return ReferenceImage(image, np.zeros_like(image))


@pytest.mark.parametrize("sigma", [0.0, 3.0])
def test_the_noise_of_the_reference_is_known(sigma: float) -> None:
    """60 noisy references of one truth: the mean power of their errors is what is subtracted."""
    rng = np.random.default_rng(1)
    # Little at the border, where a smoothed reference is noisier than elsewhere.
    deviation = 0.02 + 0.3 * np.outer(*(np.sin(np.pi * np.arange(n) / n) for n in SHAPE))
    variance = _grey(deviation**2)
    frames = np.ones((1, *SHAPE, 3))
    power, known = np.zeros(SHAPE), np.zeros(SHAPE)
    square, seen = [], []
    for _ in range(60):
        noisy = _grey(1.0 + deviation * rng.standard_normal(SHAPE))
        reference = smooth(ReferenceImage(noisy, variance), sigma)
        power += spectrum.power_spectrum(relative_errors(frames, reference, None)) / 60
        known += reference_noise(reference, None, "hann") / 60
        square.append(np.mean(relative_errors(frames, reference, None) ** 2))
        square[-1] -= np.mean(reference_noise(reference, None))
        seen.append(filtered_mse(frames, reference))
    bands = ((0.03, 0.06), (0.06, 0.17)) if sigma else ((0.03, 0.06), (0.06, 0.17), (0.17, 0.5))
    for found, expected in zip(
        spectrum.band_power(power, bands), spectrum.band_power(known, bands), strict=True
    ):
        assert found == pytest.approx(expected, rel=0.15)
    # The image is the truth: nothing is left but the reference's noise, and that is subtracted.
    total = float(np.mean(deviation**2)) / (4 * np.pi * sigma**2 if sigma else 1.0)
    assert abs(np.mean(square)) < 0.06 * total
    assert abs(np.mean(seen)) < 0.1 * total


def test_covariance_is_that_between_runs_at_equal_frames() -> None:
    rng = np.random.default_rng(2)
    reference = _exact()
    images = 1.0 + 0.2 * rng.standard_normal((6, 3, *SHAPE))
    images = ndimage.gaussian_filter(images, (0, 0, 1, 1))
    # Frames of a run have a common error: between runs it is noise like any other.
    images += 0.1 * rng.standard_normal((6, 1, *SHAPE))
    rows = _rows("covariance", _data({"a": _grey(images)}, reference))
    single = [run_products([images[:, t]], reference.image).covariance.value for t in range(3)]
    found = rows["a", "relative covariance r=8"].value
    assert found.value == pytest.approx(np.mean(single), rel=1e-4)
    assert found.low < found.value < found.high


def test_bands_know_white_noise() -> None:
    rng = np.random.default_rng(3)
    white = 1.0 + 0.3 * rng.standard_normal((8, 2, *SHAPE))
    data = _data({"a": _grey(white), "b": _grey(1.0 + 0.5 * (white - 1.0))}, _exact())
    expected = 0.09 / 1.01**2
    bands = _rows("bands", data)
    power = bands["a", "power 0.06-0.17"].value
    assert power.low < expected < power.high
    ratio = bands["b", "power 0.06-0.17"].ratio
    assert ratio is not None
    assert ratio.value == pytest.approx(0.25, rel=1e-4)
    assert bands["b", "power 0.06-0.17"].p_value == pytest.approx(2 / 2**8)
    shares = _rows("radial_spectrum", data)
    share = shares["a", "low-frequency share, white = 1"].value
    assert share.low < 1.0 < share.high
    errors = _rows("rmse_relative", data)
    assert errors["a", "relative RMSE"].value.value == pytest.approx(expected**0.5, rel=0.02)
    assert errors["b", "relative RMSE, clipped"].ratio.value == pytest.approx(0.5, rel=1e-4)  # type: ignore[union-attr]


def _blocks_off(data: Measured, name: str) -> tuple[float, float]:
    """Share of the blocks that are off, and the p-value of all together."""
    title = "blocks of 8 pixels off the reference"
    rows = _rows("block_bias", data)
    return (
        rows[name, f"{title}, 5 % by chance"].value.value,
        rows[name, f"{title}, p of no bias"].value.value,
    )


def test_the_bias_of_pixels_is_found() -> None:
    """A checkerboard of +-4 %: no mean and no block shows it, products of runs do."""
    rng = np.random.default_rng(4)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    pattern = 0.04 * (-1.0) ** (x + y)
    noise = 0.2 * rng.standard_normal((8, 4, *SHAPE))
    images = {"plain": _grey(1.0 + noise), "biased": _grey(1.0 + 0.9 * noise + pattern)}
    data = _data(images, _exact())
    rows = _rows("pixel_bias", data)
    truth = 0.04 / 1.01
    plain = rows["plain", "rms pixel bias"].value
    assert plain.low == 0.0
    assert plain.high < 0.015
    against_truth = rows["biased", "rms pixel bias"].value
    assert against_truth.low < truth < against_truth.high
    paired = rows["biased", "rms pixel bias against the baseline"].value
    assert paired.low < truth < paired.high
    # What both share of the noise cancels.
    assert paired.high - paired.low < 0.5 * (against_truth.high - against_truth.low)
    means = _rows("mean_bias", data)
    assert abs(means["biased", "mean against the baseline, minus 1"].value.value) < 0.002
    assert means["biased", "mean against the baseline, minus 1"].p_value is not None
    for name in data.runs:
        share, p_value = _blocks_off(data, name)
        assert share < 0.2
        assert p_value > 1e-3
    for quantity in ("rms pixel bias", "rms pixel bias against the baseline"):
        p_value = rows["biased", quantity].p_value
        assert p_value is not None
        assert p_value < 1e-3


def test_p_values_of_pixel_bias_raise_no_alarm() -> None:
    rng = np.random.default_rng(12)
    alarms, trials = np.zeros(2), 100
    for _ in range(trials):
        images = 1.0 + 0.2 * rng.standard_normal((2, 5, 1, 32, 32))
        reference = ReferenceImage(np.ones((32, 32, 3)), np.zeros((32, 32, 3)))
        rows = _rows("pixel_bias", _data({"a": _grey(images[0]), "b": _grey(images[1])}, reference))
        for i, quantity in enumerate(("rms pixel bias", "rms pixel bias against the baseline")):
            p_value = rows["b", quantity].p_value
            assert p_value is not None
            alarms[i] += p_value < 0.05
    assert np.all(alarms < 0.1 * trials)


def test_covariances_and_correlations_are_compared() -> None:
    """Correlated frames against white ones: p-values small there, not where both are alike."""
    rng = np.random.default_rng(13)
    white = rng.standard_normal((3, 6, 4, 48, 48))
    trail = ndimage.uniform_filter1d(white[1], 2, axis=1)
    blurred = ndimage.gaussian_filter(trail, (0, 0, 1, 1))
    images = {"a": white[0], "correlated": blurred, "alike": white[2]}
    truth = np.ones((48, 48, 3))
    data = _data(
        {name: _grey(1.0 + 0.1 * e) for name, e in images.items()}, ReferenceImage(truth, 0 * truth)
    )
    for quantity, title in (
        ("covariance", "relative covariance r=8"),
        ("covariance", "mean correlation r=8"),
        ("temporal_covariance", "covariance of consecutive frames"),
    ):
        rows = _rows(quantity, data)
        assert rows["a", title].p_value is None
        found = {name: rows[name, title].p_value for name in ("correlated", "alike")}
        assert found["correlated"] is not None
        assert found["correlated"] < 0.01
        assert found["alike"] is not None
        assert found["alike"] > 0.02


def test_biased_blocks_are_found() -> None:
    rng = np.random.default_rng(5)
    images = 1.0 + 0.2 * rng.standard_normal((8, 4, *SHAPE))
    images[..., :16, :24] *= 1.2
    share, p_value = _blocks_off(_data({"a": _grey(images)}, _exact()), "a")
    assert share > 0.06
    assert p_value < 1e-4


@pytest.mark.parametrize("sigma", [0.0, 3.0])
def test_blocks_know_the_reference_before_it_was_smoothed(sigma: float) -> None:
    """Smoothing correlates the reference's pixels: its blocks err more than they seem to."""
    rng = np.random.default_rng(7)
    shares, p_values = [], []
    for _ in range(20):
        noisy = _grey(1.0 + 0.2 * rng.standard_normal(SHAPE))
        reference = smooth(ReferenceImage(noisy, np.full_like(noisy, 0.04)), sigma)
        images = 1.0 + 0.2 * rng.standard_normal((8, 1, *SHAPE))
        share, p_value = _blocks_off(_data({"a": _grey(images)}, reference), "a")
        shares.append(share)
        p_values.append(p_value)
    assert np.mean(shares) == pytest.approx(0.05, abs=0.01)
    assert np.median(p_values) > 0.2


@pytest.mark.parametrize("sigma", [0.0, 3.0])
def test_the_interval_of_the_mean_ratio_has_the_error_of_the_reference(sigma: float) -> None:
    rng = np.random.default_rng(11)
    hits, trials = 0, 100
    for _ in range(trials):
        noisy = _grey(1.0 + 0.2 * rng.standard_normal(SHAPE))
        reference = smooth(ReferenceImage(noisy, np.full_like(noisy, 0.04)), sigma)
        images = 1.0 + 0.2 * rng.standard_normal((5, 1, *SHAPE))
        (row,) = _rows("mean_ratio", _data({"a": _grey(images)}, reference)).values()
        hits += row.value.low <= 1.0 <= row.value.high
    assert 0.9 * trials <= hits <= 0.99 * trials


def _noisy(variance: float) -> ReferenceImage:
    rng = np.random.default_rng(8)
    noise = _grey(np.sqrt(variance) * rng.standard_normal(SHAPE))
    return ReferenceImage(1.0 + noise, np.full((*SHAPE, 3), variance))


def _refusals(name: str, data: Measured) -> list[str]:
    return [found.reason for found in QUANTITIES[name].rows(data) if isinstance(found, Refused)]


@pytest.mark.parametrize(("name", "refused"), [("relmse", False), ("relmse_average", True)])
def test_the_image_that_is_measured_is_checked(name: str, refused: bool) -> None:
    """A reference that is surer than a frame and not than the mean of 8."""
    rng = np.random.default_rng(9)
    images = 1.0 + 0.3 * rng.standard_normal((2, 8, *SHAPE))
    data = _data({"a": _grey(images)}, _noisy(0.3**2 / 5))
    assert bool(_refusals(name, data)) == refused


@pytest.mark.parametrize(
    ("name", "refused"),
    [
        ("rmse", []),
        ("relmse", []),
        ("rmse_relative", ["relative RMSE, clipped"]),
        ("relmse_trimmed", ["relMSE, trimmed"]),
        ("smape", ["SMAPE"]),
        ("filtered_mse", ["filtered MSE, 1.5 px"]),
        ("covariance", []),
    ],
)
def test_fireflies_do_not_excuse_a_noisy_reference(name: str, refused: list[str]) -> None:
    """They are most of a squared error, and nothing of what is clipped."""
    rng = np.random.default_rng(12)
    images = 1.0 + 0.05 * rng.standard_normal((3, 1, *SHAPE))
    images[..., 5, 7] = 200.0
    data = replace(_data({"a": _grey(images)}, _noisy(0.1**2)), trim=0.001)
    found = _refusals(name, data)
    assert [reason.partition(" at ")[0] for reason in found] == refused


def test_one_firefly_of_the_reference_does_not_refuse_what_is_clipped() -> None:
    rng = np.random.default_rng(16)
    reference = _noisy(0.02**2)
    reference.variance[20, 30] = 900.0
    data = _data({"a": _grey(1.0 + 0.3 * rng.standard_normal((2, 1, *SHAPE)))}, reference)
    for name in ("smape", "filtered_mse", "bands", "radial_spectrum"):
        assert not _refusals(name, data)
    (reason,) = _refusals("rmse_relative", data)
    assert reason.startswith("relative RMSE at")


@pytest.mark.parametrize(("trim", "refused"), [(0.0, False), (0.05, True)])
def test_what_the_study_trims_is_no_excuse(trim: float, refused: bool) -> None:
    """A reference of 5 % noise, images of 2 % with fireflies in 3 % of the pixels."""
    rng = np.random.default_rng(17)
    images = 1.0 + 0.02 * rng.standard_normal((2, 1, *SHAPE))
    images[rng.random(images.shape) < 0.03] = 5.0
    data = replace(_data({"a": _grey(images)}, _noisy(0.05**2)), trim=trim)
    assert bool(_refusals("relmse_trimmed", data)) == refused


@pytest.mark.parametrize(("epsilon", "refused"), [(1.0, False), (1e-5, True)])
def test_what_the_study_weighs_is_checked(epsilon: float, refused: bool) -> None:
    """Dark pixels, whose reference is noisy, decide where epsilon is small."""
    rng = np.random.default_rng(18)
    truth = np.full(SHAPE, 0.02)
    truth[:8] = 1.0
    noise = rng.standard_normal((2, 1, *SHAPE))
    images = truth * (1.0 + np.where(truth == 1.0, 0.3, 0.05) * noise)
    variance = np.where(truth == 1.0, 1e-6, 0.005**2)
    noisy = truth + np.sqrt(variance) * rng.standard_normal(SHAPE)
    data = _data({"a": _grey(images)}, ReferenceImage(_grey(noisy), _grey(variance)))
    assert bool(_refusals("relmse", replace(data, epsilon=epsilon))) == refused


def test_no_error_at_all_is_no_failure() -> None:
    data = _data({"a": np.ones((2, 1, *SHAPE, 3))}, _exact())
    for name in ("bands", "radial_spectrum", "rmse", "relmse", "filtered_mse", "smape"):
        assert not _refusals(name, data)
        assert all(
            row.value.value == 0.0
            for row in _rows(name, data).values()
            if "share" not in row.quantity
        )


def test_spectra_of_mutations_are_refused_with_a_noisy_reference() -> None:
    data = _data({"a": np.ones((2, 1, *SHAPE, 3))}, _noisy(0.1**2))
    probes = {("a", "mutation_spectra"): [{SHARE: share, "power": 1.0} for share in (0.1, 0.2)]}
    assert {q for _, q in _rows("mutation_spectra", replace(data, probes=probes))} == {
        SHARE,
        "power",
    }
    noisy = {("a", "mutation_spectra"): [{SHARE: share, "power": 1.0} for share in (0.1, 0.8)]}
    (reason,) = _refusals("mutation_spectra", replace(data, probes=noisy))
    assert "80 % of the squared error of 'a'" in reason


def test_equal_time_has_an_interval_where_variants_took_turns() -> None:
    rng = np.random.default_rng(19)
    images = {name: _grey(1.0 + 0.1 * rng.standard_normal((4, 1, *SHAPE))) for name in "abc"}
    data = _data(images, _exact())
    runs = {
        name: [
            replace(run, session=f"{k}{name if name == 'c' else ''}") for k, run in enumerate(own)
        ]
        for name, own in data.runs.items()
    }
    rows = _rows("equal_time", replace(data, runs=runs))
    quantity = "equal time: last frame at its own time"
    paired, not_paired = rows["b", quantity], rows["c", quantity]
    assert paired.p_value is not None
    assert paired.value.low < paired.value.value < paired.value.high
    assert not_paired.p_value is None
    assert np.isnan(not_paired.value.low)
    assert not_paired.value.value == pytest.approx(1.0, rel=0.1)


def test_bands_are_refused_one_by_one() -> None:
    """Blue noise has little where the reference's white noise has as much as elsewhere."""
    rng = np.random.default_rng(13)
    noise = rng.standard_normal((3, 1, *SHAPE))
    blue = noise - ndimage.gaussian_filter(noise, (0, 0, 1.5, 1.5))
    data = _data({"a": _grey(1.0 + 0.3 * blue)}, _noisy(0.1**2))
    refused = [reason.partition(" at ")[0] for reason in _refusals("bands", data)]
    given = {quantity for _, quantity in _rows("bands", data)}
    assert "power 0.02-0.06" in refused
    assert {"power 0.17-0.25", "power 0.25-0.5"} <= given
    assert not given & set(refused)
    assert _refusals("radial_spectrum", data)
    assert not _rows("radial_spectrum", data)


def test_a_perfect_image_is_refused_whatever_the_weights() -> None:
    """Over the noisy reference itself, its noise of 30 % would seem a third of the relMSE."""
    rng = np.random.default_rng(14)
    noisy = 1.0 + 0.3 * rng.standard_normal((*SHAPE, 1)) * np.ones(3)
    reference = ReferenceImage(noisy, np.full((*SHAPE, 3), 0.3**2))
    data = _data({"a": np.ones((1, 1, *SHAPE, 3))}, reference)
    assert _refusals("relmse", data)


def test_the_displayed_error_is_without_that_of_the_reference() -> None:
    rng = np.random.default_rng(15)
    truth = np.broadcast_to(np.linspace(0.05, 0.9, SHAPE[1])[:, None], (*SHAPE, 3))
    images = truth * (1.0 + 0.1 * rng.standard_normal((2, 1, *SHAPE, 3)))
    sigma = 0.05 * truth
    noisy = ReferenceImage(truth + sigma * rng.standard_normal(truth.shape), sigma**2)
    exact = ReferenceImage(truth.astype(np.float64), np.zeros(truth.shape))
    (found,), (expected,) = (
        _rows("rmse_displayed", _data({"a": images}, reference)).values()
        for reference in (noisy, exact)
    )
    assert found.value.value == pytest.approx(expected.value.value, rel=0.01)
    (biased,) = _rows(
        "rmse_displayed", _data({"a": images}, replace(noisy, variance=0.0 * sigma))
    ).values()
    assert biased.value.value > 1.08 * expected.value.value


def test_all_runs_are_checked_and_the_advice_is_enough() -> None:
    rng = np.random.default_rng(10)
    images = 1.0 + 0.002 * rng.standard_normal((2, 1, *SHAPE))
    images[1] += 0.008 * rng.standard_normal(SHAPE)
    # The variance is 3.6e-5 in the mean; the first run alone would be refused.
    assert not _refusals("relmse", _data({"a": _grey(images)}, _noisy(2e-5)))
    (reason,) = _refusals("relmse", _data({"a": _grey(images)}, _noisy(16.2e-5)))
    assert "give the reference 5 times" in reason
    assert not _refusals("relmse", _data({"a": _grey(images)}, _noisy(16.2e-5 / 5)))


def test_the_advice_is_for_the_variant_that_needs_most() -> None:
    rng = np.random.default_rng(11)
    frames = {
        name: _grey(1.0 + sigma * rng.standard_normal((2, 1, *SHAPE)))
        for name, sigma in (("some", 0.02), ("most", 0.01))
    }
    (reason,) = _refusals("relmse", _data(frames, _noisy(4.5e-4)))
    assert re.search("'most'.* give the reference 5 times", reason)
    assert not _refusals("relmse", _data(frames, _noisy(4.5e-4 / 5)))


def test_a_reference_without_an_error_beside_it_gets_no_number() -> None:
    reference = _noisy(0.1)
    half = 1.0 + 0.5 * (reference.image - 1.0)
    (reason,) = _refusals("relmse", _data({"a": half[None, None]}, reference))
    assert "cannot be told" in reason


def _timed(seconds: np.ndarray) -> list[Run]:
    """Runs of which only the times (runs, frames) matter."""
    image = np.ones((1, 1, 3), dtype=np.float32)
    return [Run(image, image, times) for times in seconds]


def test_intervals_of_times_hold_where_frames_of_a_run_are_alike() -> None:
    """The load of the machine changes from run to run, by more than from frame to frame."""
    rng = np.random.default_rng(6)
    trials, hits, rejected = 200, np.zeros(4), 0
    for _ in range(trials):
        load = rng.lognormal(0.0, 0.05, (2, 6, 1)) * rng.lognormal(0.0, 0.02, (2, 6, 20))
        runs = {name: _timed(0.01 * times) for name, times in zip("ab", load, strict=True)}
        data = Measured("10x10", runs, "a", {"a": "a", "b": "a"}, None, 0.01, 0.0)
        time, (rate, pixel) = _rows("time", data), list(_rows("speed", data).values())[:2]
        ratio, p_value = time["b", "time of a frame"].ratio, time["b", "time of a frame"].p_value
        assert ratio is not None
        assert p_value is not None
        found = (time["a", "time of a frame"].value, ratio, rate.value, pixel.value)
        truth = (10.0, 1.0, 100.0, 1e5)
        hits += [i.low <= t <= i.high for i, t in zip(found, truth, strict=True)]
        rejected += p_value < 0.05
    assert np.all(hits >= 0.92 * trials)
    assert rejected < 0.09 * trials


def test_the_time_of_a_single_run_has_no_interval() -> None:
    runs = {"a": _timed(np.array([[1.0, 2.0, 4.0]])), "b": _timed(np.array([[2.0, 2.0, 2.0]]))}
    data = Measured("1x1", runs, "a", {"a": "a", "b": "a"}, None, 0.01, 0.0)
    row = _rows("time", data)["b", "time of a frame"]
    assert row.value.value == 2000.0
    assert row.ratio is not None
    assert row.ratio.value == 1.0
    assert np.isnan([row.value.low, row.ratio.low]).all()
    assert row.p_value is None


def test_blotches_are_seen_through_wide_gaussians() -> None:
    """White noise of variance v through a Gaussian of s pixels has v / (4 pi s^2)."""
    rng = np.random.default_rng(11)
    data = _data({"a": _grey(1.0 + 0.3 * rng.standard_normal((40, 2, *SHAPE)))}, _exact())
    rows = _rows("blotches", data)
    for sigma in (3.0, 8.0):
        row = rows["a", f"filtered MSE, {sigma:g} px"]
        expected = (0.3 / 1.01) ** 2 / (4 * np.pi * sigma**2)
        # At the border, mirrored, there is more of it.
        assert expected < row.value.value < 1.5 * expected


def test_variance_is_that_of_pixels_and_trimmed_by_pixels() -> None:
    """Ten pixels of 6,144 have another variance; the trimmed value is that of the others."""
    rng = np.random.default_rng(12)
    deviation = np.full(SHAPE, 0.3)
    deviation[0, :10] = 30.0
    noise = rng.standard_normal((32, 8, *SHAPE)) * deviation
    variance = _grey(np.full(SHAPE, 0.04))
    reference = ReferenceImage(_grey(1.0 + 0.2 * rng.standard_normal(SHAPE)), variance)
    data = _data({"a": _grey(1.0 + noise), "half": _grey(1.0 + 0.5 * noise)}, reference)
    data = replace(data, trim=10.5 / deviation.size)
    slow = [replace(run, times=run.times * 3) for run in data.runs["half"]]
    rows = _rows("variance", replace(data, runs={**data.runs, "half": slow}))
    for label, scale in (("", 1.0), (" x time", 1e3)):
        row = rows["a", f"relative variance{label}"]
        assert row.unit == ("ms" if label else "")
        expected = float(np.mean(deviation**2 / reference.scale**2)) * scale
        assert row.value.low < expected < row.value.high
        row = rows["a", f"relative variance{label}, trimmed"]
        assert row.value.value == pytest.approx(0.09 / 1.01**2 * scale, rel=0.05)
    ratio = rows["half", "relative variance, trimmed"].ratio
    assert ratio is not None
    assert ratio.value == pytest.approx(0.25, rel=0.02)
    ratio = rows["half", "relative variance x time, trimmed"].ratio
    assert ratio is not None
    assert ratio.value == pytest.approx(0.75, rel=0.02)


def test_half_of_a_gain_that_comes_exponentially() -> None:
    """Errors fall to a quarter of the baseline's with 2^(-t/4): half of the gain after 4 frames."""
    rng = np.random.default_rng(13)
    t = np.arange(40)
    noise = rng.standard_normal((4, 40, *SHAPE))
    gain = np.log(4.0) * (1.0 - 2.0 ** (-t / 4))
    faster = noise * np.exp(-0.5 * gain)[:, None, None]
    images = {"base": _grey(1.0 + 0.3 * noise), "learns": _grey(1.0 + 0.3 * faster)}
    images["worse"] = _grey(1.0 + 0.6 * noise)
    rows = _rows("cold_start", replace(_data(images, _exact()), settled=False))
    assert set(rows) == {("learns", "frames until half of the gain")}
    row = rows["learns", "frames until half of the gain"]
    assert row.value.value == pytest.approx(5, abs=0.3)
    assert row.ratio is None


def test_averages_are_measured_raw_and_denoised() -> None:
    pytest.importorskip("mitsuba_oidn")
    rng = np.random.default_rng(14)
    data = _data({"a": _grey(1.0 + 0.3 * rng.standard_normal((3, 9, *SHAPE)))}, _exact())
    rows = _rows("average", data)
    raw = rows["a", "relMSE of the average, trimmed"].value.value
    assert raw == pytest.approx(0.01 / 1.01, rel=0.05)
    assert rows["a", "relMSE of the average after OIDN"].value.value < 0.1 * raw


def test_flicker_is_what_changes_and_covariance_what_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Frames are a common error of 0.2 and one of 0.1 of their own, and denoising halves both."""
    monkeypatch.setattr(errors, "denoise", lambda frame: 1.0 + 0.5 * (frame - 1.0))
    rng = np.random.default_rng(18)
    stays = 0.2 * rng.standard_normal((6, 1, *SHAPE))
    changes = 0.1 * rng.standard_normal((6, 4, *SHAPE))
    images = {"a": _grey(1.0 + changes + stays), "calm": _grey(1.0 + 0.5 * changes + stays)}
    rows = _rows("flicker", _data(images, _exact()))
    flicker, shared = "flicker after OIDN", "covariance of consecutive frames after OIDN"
    scale = smoothed_reference(np.ones((*SHAPE, 3))).mean() ** 2
    assert rows["a", flicker].value.value == pytest.approx(2 * 0.05**2 / scale, rel=0.02)
    assert rows["a", shared].value.value == pytest.approx(0.1**2 / scale, rel=0.05)
    ratio = rows["calm", flicker].ratio
    assert ratio is not None
    assert ratio.value == pytest.approx(0.25, rel=0.02)


def test_errors_times_the_time_of_their_own_run() -> None:
    """Frames of run k take k + 1 seconds; relMSE of an error of 0.1 is 0.01 / 1.01."""
    images = 1.0 + 0.1 * np.ones((2, 3, *SHAPE))
    data = _data({"a": _grey(images), "b": _grey(1.0 + 2.0 * (images - 1.0))}, _exact())
    timed = {
        name: [replace(run, times=(k + 1.0) * run.times) for k, run in enumerate(runs)]
        for name, runs in data.runs.items()
    }
    rows = _rows("error_time", replace(data, runs=timed))
    error = rows["a", "relMSE, trimmed, x time"]
    assert error.value.value == pytest.approx(1500.0 * 0.01 / 1.01, rel=1e-3)
    assert error.unit == "ms"
    # A constant error is seen whole through any Gaussian.
    for sigma in (3, 8):
        seen = rows["a", f"filtered MSE, {sigma} px, x time"].value.value
        assert seen == pytest.approx(1500.0 * 0.01 / 1.01**2, rel=0.05)
    ratio = rows["b", "relMSE, trimmed, x time"].ratio
    assert ratio is not None
    assert ratio.value == pytest.approx(4.0, rel=1e-3)


def test_variants_that_were_not_rendered_have_no_error_times_time() -> None:
    data = _data({"a": _grey(np.full((2, 1, *SHAPE), 1.1))}, _exact())
    blurred = [replace(run, times=np.zeros(0)) for run in data.runs["a"]]
    rows = _rows("error_time", replace(data, runs={**data.runs, "blurred": blurred}))
    assert {variant for variant, _ in rows} == {"a"}
