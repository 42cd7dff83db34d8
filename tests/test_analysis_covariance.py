"""Covariance of independent runs against brute force, NumPy and fields of known covariance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from mitsuba_restir.analysis.covariance import RunProducts, run_products, temporal_covariance
from mitsuba_restir.analysis.covariance_images import covariance_map, lag_products
from mitsuba_restir.analysis.images import LUMINANCE_WEIGHTS, smoothed_reference
from mitsuba_restir.analysis.intervals import Interval

RADIUS = 2


def _brute_force(runs: np.ndarray, reference: np.ndarray, radius: int) -> tuple[float, float]:
    """The definition, pixel by pixel: mean over the window without and with the pixel itself."""
    count, height, width = runs.shape
    scale = smoothed_reference(reference)
    means = runs.mean(axis=0)
    without, including = [], []
    for y in range(height):
        for x in range(width):
            others, everyone = [], []
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                for u in range(max(x - radius, 0), min(x + radius + 1, width)):
                    total = 0.0
                    for image in runs:
                        total += (image[y, x] - means[y, x]) * (image[v, u] - means[v, u])
                    c = total / (count - 1) / (scale[y, x] * scale[v, u])
                    everyone.append(c)
                    if (v, u) != (y, x):
                        others.append(c)
            without.append(np.mean(others))
            including.append(np.mean(everyone))
    return float(np.mean(without)), float(np.mean(including))


def relative_covariance(runs: np.ndarray, reference: np.ndarray, *, radius: int = 8) -> RunProducts:
    return run_products([runs], reference, radius=radius)


def covariance_ratio(
    first: np.ndarray, second: np.ndarray, reference: np.ndarray, *, radius: int = 8
) -> Interval:
    own, base = (relative_covariance(r, reference, radius=radius) for r in (first, second))
    return own.covariance.over(base.covariance)


def lag_covariance(runs: np.ndarray, reference: np.ndarray, *, radius: int) -> np.ndarray:
    return lag_products(runs, reference, radius=radius).sum(axis=0) / (len(runs) - 1)


@pytest.fixture
def field() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    reference = 0.5 + rng.random((9, 11))
    noise = ndimage.gaussian_filter(rng.normal(size=(6, 9, 11)), (0, 1, 1))
    return reference * (1.0 + noise), reference


def test_against_brute_force(field: tuple[np.ndarray, np.ndarray]) -> None:
    runs, reference = field
    found = relative_covariance(runs, reference, radius=RADIUS)
    without, including = _brute_force(runs, reference, RADIUS)
    assert found.covariance.value == pytest.approx(without, rel=1e-10)
    assert found.with_self.value == pytest.approx(including, rel=1e-10)
    variance = (runs.var(axis=0, ddof=1) / smoothed_reference(reference) ** 2).mean()
    assert found.variance.value == pytest.approx(variance, rel=1e-10)
    assert found.correlation.value == pytest.approx(without / variance, rel=1e-10)


def test_colour_is_luminance(field: tuple[np.ndarray, np.ndarray]) -> None:
    runs, reference = field
    tint = np.array([1.2, 0.9, 0.7])
    grey = float(tint @ LUMINANCE_WEIGHTS)
    colour = relative_covariance(runs[..., None] * tint, reference[..., None] * tint)
    plain = relative_covariance(grey * runs, grey * reference)
    assert colour.covariance.value == pytest.approx(plain.covariance.value)


def test_images_against_numpy(field: tuple[np.ndarray, np.ndarray]) -> None:
    runs, reference = field
    scale = smoothed_reference(reference)
    full = np.cov((runs / scale).reshape(6, -1), rowvar=False).reshape(9, 11, 9, 11)
    lags = lag_covariance(runs, reference, radius=RADIUS)
    for dy in range(-RADIUS, RADIUS + 1):
        for dx in range(-RADIUS, RADIUS + 1):
            pairs = [
                full[y, x, y + dy, x + dx]
                for y in range(max(0, -dy), min(9, 9 - dy))
                for x in range(max(0, -dx), min(11, 11 - dx))
            ]
            assert lags[RADIUS + dy, RADIUS + dx] == pytest.approx(np.mean(pairs), rel=1e-9)
    window = covariance_map(runs, reference, radius=RADIUS)
    total = relative_covariance(runs, reference, radius=RADIUS)
    assert window.mean() == pytest.approx(total.covariance.value, rel=1e-10)
    corner = full[0, 0, : RADIUS + 1, : RADIUS + 1].sum() - full[0, 0, 0, 0]
    assert window[0, 0] == pytest.approx(corner / ((RADIUS + 1) ** 2 - 1), rel=1e-9)


def test_leaving_a_run_out_is_exact(field: tuple[np.ndarray, np.ndarray]) -> None:
    """From the inner products of all runs as from the images of all but one."""
    runs, reference = field
    products = relative_covariance(runs, reference, radius=RADIUS)
    for name in ("covariance", "with_self", "variance", "correlation"):
        found = getattr(products, name)
        others = [
            relative_covariance(np.delete(runs, k, axis=0), reference, radius=RADIUS)
            for k in range(len(runs))
        ]
        expected = [getattr(other, name).value for other in others]
        np.testing.assert_allclose(found.left_out, expected, rtol=1e-9)


def test_two_runs_give_no_interval(field: tuple[np.ndarray, np.ndarray]) -> None:
    runs, reference = field
    found = relative_covariance(runs[:2], reference, radius=RADIUS).covariance.interval()
    ratio = covariance_ratio(runs[:2], runs[2:4], reference, radius=RADIUS)
    assert np.isfinite([found.value, ratio.value]).all()
    assert np.isnan([found.low, ratio.low]).all()


def _blotches(rng: np.random.Generator, count: int, share: float) -> np.ndarray:
    """Runs with relative variance 1 and covariance `share` within 4x4 blocks, 0 between them."""
    common = rng.normal(size=(count, 8, 8)).repeat(4, axis=1).repeat(4, axis=2)
    return 1.0 + np.sqrt(share) * common + np.sqrt(1 - share) * rng.normal(size=common.shape)


def test_intervals_cover_the_known_covariance() -> None:
    rng = np.random.default_rng(2)
    reference = np.ones((32, 32))
    scale = 1.01**2
    lag = np.zeros((32, 32, 32, 32))
    owner = np.arange(32) // 4
    same = owner[:, None] == owner[None, :]
    lag[...] = 0.3 * (same[:, None, :, None] & same[None, :, None, :])
    near = np.abs(np.arange(32)[:, None] - np.arange(32)[None, :]) <= RADIUS
    window = near[:, None, :, None] & near[None, :, None, :]
    counts = window.sum(axis=(2, 3)) - 1
    truth = ((lag * window).sum(axis=(2, 3)) - 0.3) / counts
    expected = float(truth.mean()) / scale
    hits, trials = np.zeros(3), 200
    for _ in range(trials):
        first, second = _blotches(rng, 10, 0.3), _blotches(rng, 10, 0.3)
        found = relative_covariance(first, reference, radius=RADIUS)
        intervals = [found.covariance.interval(), found.correlation.interval()]
        intervals.append(covariance_ratio(first, second, reference, radius=RADIUS))
        truths = (expected, expected * scale, 1.0)
        hits += [i.low <= t <= i.high for i, t in zip(intervals, truths, strict=True)]
    assert np.all(hits >= 0.92 * trials)
    assert np.all(hits <= 0.99 * trials)


def test_white_noise_has_no_covariance() -> None:
    rng = np.random.default_rng(3)
    found = relative_covariance(rng.normal(1.0, 0.5, (32, 40, 40)), np.ones((40, 40)))
    interval = found.covariance.interval()
    assert interval.low <= 0.0 <= interval.high
    assert found.variance.value == pytest.approx(0.25 / 1.01**2, rel=0.03)


def test_ratio_of_paired_variants() -> None:
    rng = np.random.default_rng(4)
    reference = np.ones((32, 32))
    common = rng.normal(size=(32, 8, 8)).repeat(4, axis=1).repeat(4, axis=2)
    white = rng.normal(size=(2, *common.shape))
    first, second = 1 + 0.8 * common + 0.3 * white[0], 1 + common + 0.3 * white[1]
    paired = covariance_ratio(first, second, reference, radius=RADIUS)
    own, base = (
        relative_covariance(runs, reference, radius=RADIUS).covariance for runs in (first, second)
    )
    apart = np.hypot(own.standard_error / own.value, base.standard_error / base.value)
    assert paired.low <= 0.64 <= paired.high
    assert paired.value == own.value / base.value
    assert paired.standard_error < 0.5 * paired.value * apart


def test_temporal_covariance() -> None:
    rng = np.random.default_rng(5)
    frames = np.zeros((24, 6, 16, 16))
    frames[:, 0] = rng.normal(size=(24, 16, 16))
    for t in range(1, 6):
        frames[:, t] = 0.8 * frames[:, t - 1] + 0.6 * rng.normal(size=(24, 16, 16))
    reference = np.ones((16, 16))
    for lag, expected in ((0, 1.0), (1, 0.8), (2, 0.64)):
        found = temporal_covariance(1.0 + frames, reference, lag=lag)
        assert found.value * 1.01**2 == pytest.approx(expected, abs=0.05)
        direct = [
            (
                (frames[:, t] - frames[:, t].mean(axis=0))
                * (frames[:, t + lag] - frames[:, t + lag].mean(axis=0))
            ).sum(axis=0)
            / 23
            for t in range(6 - lag)
        ]
        assert found.value * 1.01**2 == pytest.approx(np.mean(direct), rel=1e-9)


def test_bad_input(field: tuple[np.ndarray, np.ndarray]) -> None:
    runs, reference = field
    with pytest.raises(ValueError, match="at least 2"):
        relative_covariance(runs[:1], reference)
    with pytest.raises(ValueError, match="pixels"):
        relative_covariance(runs, reference[:4])
    with pytest.raises(ValueError, match="radius"):
        relative_covariance(runs, reference, radius=0)
    with pytest.raises(ValueError, match="radius"):
        lag_covariance(runs, reference, radius=9)
    with pytest.raises(ValueError, match="equal numbers"):
        covariance_ratio(runs, runs[:4], reference)
    with pytest.raises(ValueError, match="lag"):
        temporal_covariance(runs[None], reference, lag=6)
