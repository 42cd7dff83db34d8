"""Metrics against independent implementations: scikit-image, SciPy, pandas, and plain loops."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal, stats

from mitsuba_restir.analysis import covariance, metrics, pixel_bias, spectrum
from mitsuba_restir.analysis.bias import block_sums
from mitsuba_restir.analysis.images import luminance, smoothed_reference

filters = pytest.importorskip("skimage.filters", reason="needs scikit-image")
color = pytest.importorskip("skimage.color")
measure = pytest.importorskip("skimage.measure")
skmetrics = pytest.importorskip("skimage.metrics")

SHAPE = (37, 52)


@pytest.fixture
def pair() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(11)
    reference = rng.random((*SHAPE, 3)) + 0.1
    return reference * rng.lognormal(0.0, 0.4, reference.shape), reference


def test_luminance(pair: tuple[np.ndarray, np.ndarray]) -> None:
    """The weights of scikit-image are Rec. 709 rounded to four digits."""
    np.testing.assert_allclose(luminance(pair[0]), color.rgb2gray(pair[0]), rtol=1e-3)


def test_rmse_and_relmse(pair: tuple[np.ndarray, np.ndarray]) -> None:
    image, reference = pair
    squared = skmetrics.mean_squared_error(reference, image)
    assert metrics.rmse(image, reference) == pytest.approx(np.sqrt(squared), rel=1e-12)
    # The relative error is the plain one of images divided by the same.
    scale = np.sqrt(reference**2 + 0.03)
    relative = skmetrics.mean_squared_error(reference / scale, image / scale)
    assert metrics.relmse(image, reference, epsilon=0.03) == pytest.approx(relative, rel=1e-12)


def test_trimmed_relmse(pair: tuple[np.ndarray, np.ndarray]) -> None:
    image, reference = pair
    pixels = np.mean((image - reference) ** 2 / (reference**2 + 0.01), axis=2).ravel()
    expected = stats.trim1(pixels, 0.05, tail="right").mean()
    assert metrics.trimmed_relmse(image, reference, trim=0.05) == pytest.approx(expected)


def test_smape(pair: tuple[np.ndarray, np.ndarray]) -> None:
    """The mean of the terms that SciPy sums to the Canberra distance, but for epsilon."""
    from scipy.spatial import distance

    image, reference = (x.ravel() for x in pair)
    expected = distance.canberra(image, reference) / image.size
    found = metrics.smape(*pair, epsilon=1e-12)
    assert found == pytest.approx(expected, rel=1e-9)


def test_smoothed_reference(pair: tuple[np.ndarray, np.ndarray]) -> None:
    y = luminance(pair[1])
    expected = filters.gaussian(y, 8.0, mode="nearest", preserve_range=True) + 0.01 * y.mean()
    np.testing.assert_allclose(smoothed_reference(pair[1]), expected, rtol=1e-9)


def test_filtered_mse() -> None:
    error = np.random.default_rng(12).normal(size=(3, *SHAPE))
    seen = [filters.gaussian(e, 1.5, mode="reflect", preserve_range=True) for e in error]
    assert metrics.filtered_mse(error, 1.5) == pytest.approx(np.mean(np.square(seen)))


def test_block_sums() -> None:
    image = np.random.default_rng(13).random((40, 56, 3))
    expected = measure.block_reduce(image, (8, 8, 1), np.sum)
    np.testing.assert_allclose(block_sums(image, 8)[0], expected)


def test_relative_covariance_of_a_window() -> None:
    """Deviations of all runs convolved by SciPy with a window that has a hole in the middle."""
    rng = np.random.default_rng(14)
    runs, reference = rng.random((5, *SHAPE)) + 0.5, np.full(SHAPE, 0.8)
    radius = 3
    window = np.ones((2 * radius + 1, 2 * radius + 1))
    window[radius, radius] = 0.0
    deviations = (runs - runs.mean(axis=0)) / (0.8 * 1.01)
    count = signal.convolve2d(np.ones(SHAPE), window, mode="same")
    products = [d * signal.convolve2d(d, window, mode="same") / count for d in deviations]
    expected = np.sum(products, axis=0).mean() / 4
    found = covariance.run_products([runs], reference, radius=radius)
    assert found.covariance.value == pytest.approx(expected, rel=1e-9)


def test_temporal_covariance() -> None:
    pandas = pytest.importorskip("pandas")
    rng = np.random.default_rng(15)
    frames = rng.random((6, 4, 5, 7)) + 0.5
    frames[:, 1:] += 0.7 * frames[:, :-1]
    reference = np.full((5, 7), 1.3)
    flat = frames.reshape(6, 4, -1)
    values = []
    for pixel in range(flat.shape[2]):
        table = pandas.DataFrame(flat[:, :, pixel]).cov()
        values += [table.iloc[t, t + 1] for t in range(3)]
    found = covariance.temporal_covariance(frames, reference)
    assert found.value == pytest.approx(np.mean(values) / (1.3 * 1.01) ** 2, rel=1e-9)


def test_power_by_band() -> None:
    """The window of scikit-image, the transform of SciPy, and a loop over all frequencies."""
    error = np.random.default_rng(16).normal(size=SHAPE)
    rows, columns = (signal.get_window("hann", n) for n in SHAPE)
    window = rows[:, None] * columns[None, :]
    from scipy import fft

    power = np.abs(fft.fft2(window * (error - error.mean()))) ** 2 / np.sum(window**2)
    inside = [
        power[row, column]
        for row in range(SHAPE[0])
        for column in range(SHAPE[1])
        for f in [np.hypot(fft.fftfreq(SHAPE[0])[row], fft.fftfreq(SHAPE[1])[column])]
        if 0.06 <= f < 0.17
    ]
    found = spectrum.band_power(spectrum.power_spectrum(error), [(0.06, 0.17)])
    assert found[0] == pytest.approx(np.mean(inside), rel=1e-9)


def test_radial_spectrum() -> None:
    """Rings of equal distance, measured by scikit-image as the regions of a labelled picture."""
    n = 48
    power = np.random.default_rng(17).random((n, n))
    y, x = np.mgrid[:n, :n] - n // 2
    ring = np.rint(np.hypot(y, x)).astype(int)
    ring[ring > n // 2] = 0
    ring[np.hypot(y, x) > n // 2] = 0
    regions = measure.regionprops(ring, intensity_image=np.fft.fftshift(power))
    found = spectrum.radial_spectrum(power)
    np.testing.assert_allclose(found.power, [r.intensity_mean for r in regions])
    np.testing.assert_allclose(found.count, [r.area for r in regions])


def test_pixel_bias_by_loops() -> None:
    rng = np.random.default_rng(18)
    reference = np.full((6, 7), 2.0)
    chains = reference + 0.1 + 0.3 * rng.standard_normal((4, 6, 7))
    products = [
        np.mean((chains[a] - 2.0) * (chains[b] - 2.0) / 2.02**2)
        for a in range(4)
        for b in range(4)
        if a != b
    ]
    found = pixel_bias.squared_pixel_bias(chains, reference)
    assert found.value == pytest.approx(np.mean(products), rel=1e-9)
    ratio = pixel_bias.mean_bias(chains, np.broadcast_to(reference, chains.shape))
    low, high = stats.ttest_1samp(chains.mean(axis=(1, 2)) / 2.0 - 1.0, 0.0).confidence_interval(
        0.95
    )
    assert (ratio.low, ratio.high) == pytest.approx((low, high))


def test_flip_of_low_dynamic_range_images_against_the_order_of_ssim() -> None:
    """FLIP has no second implementation here; it orders distortions as scikit-image's SSIM does."""
    pytest.importorskip("flip_evaluator")
    rng = np.random.default_rng(19)
    y = np.linspace(0.2, 0.8, 64)[None, :, None] * np.ones((48, 1, 3))
    noise = rng.standard_normal(y.shape)
    levels = (0.01, 0.03, 0.1, 0.2)
    flip = [metrics.hdr_flip(np.maximum(y + s * noise, 0.0), y) for s in levels]
    ssim = [
        skmetrics.structural_similarity(y, y + s * noise, channel_axis=2, data_range=1.0)
        for s in levels
    ]
    assert np.argsort(flip).tolist() == np.argsort(ssim)[::-1].tolist() == [0, 1, 2, 3]
