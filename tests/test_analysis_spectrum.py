"""Spectra, filtered errors and the bias per pixel, against SciPy and analytic noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage, signal

from mitsuba_restir.analysis import intervals, metrics, pixel_bias, spectrum
from mitsuba_restir.studies.measure.frame_errors import relative_errors
from mitsuba_restir.studies.runs.results import ReferenceImage


def test_white_noise_has_the_power_of_its_variance() -> None:
    rng = np.random.default_rng(1)
    errors = rng.normal(0.0, 0.5, (20, 64, 96))
    for window in ("hann", "none"):
        power = spectrum.power_spectrum(errors, window=window)  # type: ignore[arg-type]
        f = spectrum.frequencies(power.shape)
        assert power[f > 0.05].mean() == pytest.approx(0.25, rel=0.03)
    bands = spectrum.band_power(spectrum.power_spectrum(errors), spectrum.TABLE_BANDS)
    np.testing.assert_allclose(bands, 0.25, rtol=0.1)


def test_power_against_the_definition_and_scipy() -> None:
    rng = np.random.default_rng(2)
    error = rng.normal(size=(12, 15))
    h = np.outer(np.hanning(13)[:-1], np.hanning(16)[:-1])
    centred = h * (error - error.mean())
    power = spectrum.power_spectrum(error)
    y, x = np.mgrid[:12, :15]
    for row, column in ((0, 0), (1, 2), (5, 14), (11, 3)):
        wave = np.exp(-2j * np.pi * (row * y / 12 + column * x / 15))
        expected = abs(np.sum(centred * wave)) ** 2 / np.sum(h**2)
        assert power[row, column] == pytest.approx(expected, rel=1e-9, abs=1e-12)
    line = np.tile(error[:1], (12, 1))
    rows = spectrum.power_spectrum(line, window="none")[0] / 12
    _, theirs = signal.periodogram(line[0], return_onesided=False, detrend="constant")
    np.testing.assert_allclose(rows, theirs, atol=1e-12)


def test_a_wave_appears_at_its_frequency() -> None:
    y, x = np.mgrid[:64, :64]
    error = np.cos(2 * np.pi * (6 * x + 8 * y) / 64)
    rings = spectrum.radial_spectrum(spectrum.power_spectrum(error, window="none"))
    assert rings.frequency[rings.power.argmax()] == pytest.approx(10 / 64, abs=0.5 / 64)
    assert rings.anisotropy[rings.power.argmax()] > 5.0


def test_radial_mean_by_brute_force() -> None:
    rng = np.random.default_rng(3)
    power = rng.random((20, 26))
    rings = spectrum.radial_spectrum(power)
    members: dict[int, list[float]] = {}
    for row in range(20):
        for column in range(26):
            fy, fx = (row + 10) % 20 - 10, (column + 13) % 26 - 13
            f = np.hypot(fy / 20, fx / 26)
            if 0 < f <= 0.5:
                members.setdefault(round(f * 20), []).append(power[row, column])
    expected = [np.mean(members[ring]) for ring in sorted(members)]
    np.testing.assert_allclose(rings.power, expected)
    assert rings.count.sum() == sum(map(len, members.values()))
    spread = np.var(members[5], ddof=1) / np.mean(members[5]) ** 2
    assert rings.anisotropy[sorted(members).index(5)] == pytest.approx(spread)


def test_isotropic_noise_has_no_anisotropy() -> None:
    rng = np.random.default_rng(4)
    power = spectrum.power_spectrum(rng.normal(size=(10, 64, 64)), window="none")
    # Of 10 images 1/10 is expected: 0 dB.
    decibel = 10 * np.log10(10 * spectrum.radial_spectrum(power).anisotropy)
    assert np.abs(decibel[8:]).max() < 3.0


def test_filtered_noise_has_the_power_of_its_filter() -> None:
    rng = np.random.default_rng(5)
    noise = ndimage.gaussian_filter(rng.normal(size=(40, 64, 64)), (0, 1.5, 1.5), mode="wrap")
    power = spectrum.band_power(spectrum.power_spectrum(noise), ((0.06, 0.1), (0.1, 0.17)))
    f = spectrum.frequencies((64, 64))
    transfer = np.exp(-((2 * np.pi * 1.5 * f) ** 2))
    for found, (low, high) in zip(power, ((0.06, 0.1), (0.1, 0.17)), strict=True):
        assert found == pytest.approx(transfer[(f >= low) & (f < high)].mean(), rel=0.1)
    assert spectrum.low_frequency_share(spectrum.power_spectrum(noise)) > 3.0


def test_bands_partition_the_spectrum() -> None:
    power = np.ones((320, 180))
    np.testing.assert_allclose(spectrum.band_power(power), 1.0)
    f = spectrum.frequencies(power.shape)
    marked = np.where((f >= 0.25) & (f <= 0.5), 1.0, 0.0)
    np.testing.assert_allclose(spectrum.band_power(marked), [0, 0, 0, 0, 0, 0, 1])


def test_band_ratios_with_intervals_over_chains() -> None:
    rng = np.random.default_rng(6)
    base = np.stack([spectrum.power_spectrum(rng.normal(size=(4, 64, 64))) for _ in range(8)])
    other = np.stack(
        [spectrum.power_spectrum(0.7 * rng.normal(size=(4, 64, 64))) for _ in range(8)]
    )
    powers = (spectrum.band_power(spectra, spectrum.TABLE_BANDS).T for spectra in (other, base))
    for own, others in zip(*powers, strict=True):
        ratio = intervals.ratio_interval(own, others, level=0.999)
        power = intervals.mean_interval(own, level=0.999)
        assert ratio.low <= 0.49 <= ratio.high
        assert power.low <= 0.49 <= power.high


def test_relative_error() -> None:
    reference = np.full((16, 16, 3), 2.0)
    truth = ReferenceImage(reference, 0.0 * reference)
    error = relative_errors(1.1 * reference[None], truth, None)
    np.testing.assert_allclose(error, 0.1 / 1.01)
    firefly = reference.copy()
    firefly[3, 3] = 1e5
    assert relative_errors(firefly[None], truth, 4.0).max() == 4.0


def test_filtered_mse_of_white_noise() -> None:
    rng = np.random.default_rng(7)
    white = rng.normal(0.0, 0.3, (20, 512, 512))
    # White noise through a Gaussian keeps 1 / (4 pi sigma²) of its variance.
    expected = 0.09 / (4 * np.pi * 1.5**2)
    assert metrics.filtered_mse(white, 1.5) == pytest.approx(expected, rel=0.05)
    blotches = ndimage.gaussian_filter(white, (0, 2, 2), mode="wrap")
    for error, low, high in ((blotches, 3.0, np.inf), (white - blotches, 0.0, 0.5)):
        share = metrics.filtered_mse(error, 1.5) / (expected * np.mean(error**2) / 0.09)
        assert low < share < high
    single = metrics.filtered_mse(white[0], 1.5)
    smooth = ndimage.gaussian_filter(white[0], 1.5, mode="reflect")
    assert single == pytest.approx(np.mean(smooth**2))


def test_pixel_bias_cancels_noise() -> None:
    rng = np.random.default_rng(8)
    truth = np.ones((64, 64))
    noise_of_reference = 0.02
    reference = truth + noise_of_reference * rng.normal(size=truth.shape)
    unbiased = truth + 0.2 * rng.normal(size=(6, 64, 64))
    none = pixel_bias.squared_pixel_bias(unbiased, reference, noise_of_reference**2).interval(
        level=0.999
    )
    assert none.low <= 0.0 <= none.high
    pattern = 0.05 * np.sign(np.sin(np.arange(64)))
    some = pixel_bias.squared_pixel_bias(
        unbiased + pattern, reference, noise_of_reference**2
    ).interval(level=0.999)
    assert some.low <= 0.05**2 / 1.01**2 <= some.high
    assert some.low > 0.0


def test_pixel_bias_of_two_chains_is_their_product() -> None:
    rng = np.random.default_rng(9)
    chains = 1.0 + rng.normal(size=(2, 8, 8))
    found = pixel_bias.squared_pixel_bias(chains, np.ones((8, 8)))
    expected = np.mean((chains[0] - 1) * (chains[1] - 1)) / 1.01**2
    assert found.value == pytest.approx(expected)
    assert np.isnan(found.interval().high)


def test_mean_bias_is_paired() -> None:
    rng = np.random.default_rng(10)
    base = rng.lognormal(0.0, 1.0, (8, 24, 24))
    shown = base * (1.0 - 0.01 + 0.001 * rng.normal(size=base.shape))
    found = pixel_bias.mean_bias(shown, base)
    assert found.value == pytest.approx(-0.01, abs=5e-4)
    assert found.high < -0.008


@pytest.mark.parametrize(
    ("bands", "message"),
    [(((0.3, 0.2),), "low < high"), (((0.001, 0.002),), "No frequency"), (((0.4, 0.6),), "0.5")],
)
def test_bad_bands(bands: tuple[tuple[float, float], ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        spectrum.band_power(np.ones((32, 32)), bands)


def test_bad_input() -> None:
    with pytest.raises(ValueError, match="window"):
        spectrum.power_spectrum(np.ones((8, 8)), window="box")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="pixels"):
        pixel_bias.squared_pixel_bias(np.ones((2, 8, 8)), np.ones((8, 9)))
    with pytest.raises(ValueError, match="2 independent chains"):
        pixel_bias.squared_pixel_bias(np.ones((1, 8, 8)), np.ones((8, 8)))
