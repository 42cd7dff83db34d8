"""Errors of images and their intervals, against independent implementations and known answers."""

from __future__ import annotations

import builtins

import numpy as np
import pytest
from scipy import stats

from mitsuba_restir.analysis import intervals, metrics
from mitsuba_restir.analysis.denoise import denoise
from mitsuba_restir.analysis.images import LUMINANCE_WEIGHTS, luminance, smoothed_reference
from mitsuba_restir.imageio import to_srgb8

rng = np.random.default_rng(20240501)


@pytest.fixture
def pair() -> tuple[np.ndarray, np.ndarray]:
    reference = rng.random((12, 17, 3)) + 0.1
    return reference * rng.lognormal(0.0, 0.3, reference.shape), reference


def test_luminance_has_the_weights_of_mitsuba() -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("llvm_ad_rgb")
    theirs = [float(mi.luminance(mi.Color3f(*row.tolist()))[0]) for row in np.eye(3)]
    np.testing.assert_allclose(LUMINANCE_WEIGHTS, theirs, rtol=1e-6)


def test_luminance_shapes() -> None:
    grey = rng.random((4, 5))
    assert luminance(grey).shape == (4, 5)
    np.testing.assert_array_equal(luminance(grey[..., None]), grey)
    np.testing.assert_allclose(luminance(np.ones((4, 5, 3))), 1.0, rtol=1e-12)
    with pytest.raises(ValueError, match="1 or 3 channels"):
        luminance(np.ones((4, 5, 4)))


def test_errors_against_explicit_loops(pair: tuple[np.ndarray, np.ndarray]) -> None:
    image, reference = pair
    squared, relative, symmetric = [], [], []
    for i, r in zip(image.ravel(), reference.ravel(), strict=True):
        squared.append((i - r) ** 2)
        relative.append((i - r) ** 2 / (r * r + 0.02))
        symmetric.append(abs(i - r) / (abs(i) + abs(r) + 0.01))
    assert metrics.rmse(image, reference) == pytest.approx(np.sqrt(np.mean(squared)), rel=1e-12)
    assert metrics.relmse(image, reference, epsilon=0.02) == pytest.approx(np.mean(relative))
    assert metrics.smape(image, reference) == pytest.approx(np.mean(symmetric))


def test_trimmed_relmse_leaves_out_the_worst_pixels(pair: tuple[np.ndarray, np.ndarray]) -> None:
    image, reference = pair
    plain = metrics.relmse(image, reference)
    assert metrics.trimmed_relmse(image, reference, trim=0.0) == pytest.approx(plain)
    image[3, 4] = 1e6
    share = 1.5 / (12 * 17)
    others = np.ones((12, 17), dtype=bool)
    others[3, 4] = False
    errors = metrics.relative_squared_error(image, reference)[others]
    assert metrics.trimmed_relmse(image, reference, trim=share) == pytest.approx(errors.mean())


def test_reference_variance_is_subtracted() -> None:
    truth = np.full((200, 200), 2.0)
    noise, own = 0.4, 0.3
    reference = truth + rng.normal(0.0, noise, truth.shape)
    image = truth + rng.normal(0.0, own, truth.shape)
    assert metrics.rmse(image, reference) == pytest.approx(0.5, rel=0.03)
    known = np.full(truth.shape, noise**2)
    assert metrics.rmse(image, reference, reference_variance=known) == pytest.approx(own, rel=0.05)
    assert metrics.rmse(reference, reference, reference_variance=noise**2) == 0.0
    found = metrics.relmse(image, truth, reference_variance=0.0)
    assert found == pytest.approx(own**2 / 4.01, rel=0.03)


def test_mean_ratio(pair: tuple[np.ndarray, np.ndarray]) -> None:
    _, reference = pair
    assert metrics.mean_ratio(1.25 * reference, reference) == pytest.approx(1.25)
    with pytest.raises(ValueError, match="black"):
        metrics.mean_ratio(reference, 0.0 * reference)


@pytest.mark.parametrize(
    ("image", "reference", "message"),
    [
        (np.ones((3, 4)), np.ones((4, 3)), r"shape \(3, 4\).*\(4, 3\)"),
        (np.full((3, 4), np.nan), np.ones((3, 4)), "12 values that are NaN"),
        (np.ones(3), np.ones(3), "2 or 3 dimensions"),
        (np.ones((0, 4)), np.ones((0, 4)), "empty"),
    ],
)
def test_bad_images(image: np.ndarray, reference: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        metrics.rmse(image, reference)


def test_bad_parameters(pair: tuple[np.ndarray, np.ndarray]) -> None:
    with pytest.raises(ValueError, match="epsilon must be positive"):
        metrics.relmse(*pair, epsilon=0.0)
    with pytest.raises(ValueError, match="trim"):
        metrics.trimmed_relmse(*pair, trim=1.0)
    with pytest.raises(ValueError, match="reference variance has shape"):
        metrics.rmse(*pair, reference_variance=np.ones((2, 2)))
    with pytest.raises(ValueError, match="negative"):
        metrics.rmse(*pair, reference_variance=-1.0)


def test_flip(pair: tuple[np.ndarray, np.ndarray]) -> None:
    pytest.importorskip("flip_evaluator")
    image, reference = pair
    assert metrics.hdr_flip(reference, reference) == pytest.approx(0.0, abs=1e-6)
    small = metrics.hdr_flip(0.98 * reference, reference)
    assert 0.0 < small < metrics.hdr_flip(image, reference) <= 1.0


def test_flip_says_what_is_missing(
    pair: tuple[np.ndarray, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = builtins.__import__

    def without(name: str, *args: object, **kwargs: object) -> object:
        if name == "flip_evaluator":
            raise ImportError(name)
        return plain(name, *args, **kwargs)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match="pip install flip-evaluator"):
        metrics.hdr_flip(*pair)


def test_denoising_removes_noise() -> None:
    pytest.importorskip("mitsuba_oidn")
    reference = np.full((32, 48, 3), 0.5)
    image = reference * rng.lognormal(0.0, 0.3, reference.shape)
    clean = denoise(image)
    assert clean.shape == image.shape
    assert metrics.rmse(clean, reference) < 0.5 * metrics.rmse(image, reference)


def test_smoothed_reference() -> None:
    flat = smoothed_reference(np.full((20, 30, 3), 2.0))
    np.testing.assert_allclose(flat, 2.0 * 1.01)
    with pytest.raises(ValueError, match="black"):
        smoothed_reference(np.zeros((4, 4)))


def test_mean_interval_against_scipy() -> None:
    values = rng.normal(3.0, 1.0, 12)
    found = intervals.mean_interval(values)
    low, high = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert (found.low, found.high) == pytest.approx((low, high))


def _coverage(build: object, truth: float, trials: int = 300) -> float:
    hits = 0
    for _ in range(trials):
        found = build()  # type: ignore[operator]
        hits += found.low <= truth <= found.high
    return hits / trials


def test_ratio_interval_covers() -> None:
    def build() -> intervals.Interval:
        common = rng.lognormal(0.0, 0.4, 8)
        first = 0.5 * common * rng.lognormal(0.0, 0.2, 8)
        second = common * rng.lognormal(0.0, 0.2, 8)
        return intervals.ratio_interval(first, second)

    assert 0.90 <= _coverage(build, 0.5) <= 0.99


def test_jackknife_of_a_mean_is_student() -> None:
    values = rng.normal(size=9)
    found = intervals.jackknife(values, lambda v: float(v.mean())).interval()
    expected = intervals.mean_interval(values)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))


def test_paired_difference() -> None:
    common = rng.lognormal(0.0, 1.0, 12)
    first, second = common + 0.1 + rng.normal(0.0, 0.02, 12), common
    assert intervals.sign_flip_p_value(first, second) < 0.01
    assert intervals.mean_interval(first - second).low > 0.0
    p_values = [intervals.sign_flip_p_value(*rng.normal(size=(2, 8))) for _ in range(200)]
    assert np.mean(np.array(p_values) < 0.1) == pytest.approx(0.1, abs=0.07)


def test_intervals_need_runs() -> None:
    with pytest.raises(ValueError, match="at least 2"):
        intervals.mean_interval([1.0])
    with pytest.raises(ValueError, match="positive means"):
        intervals.ratio_interval([1.0, -3.0], [1.0, 1.0])
    with pytest.raises(ValueError, match="one shape"):
        intervals.sign_flip_p_value([1.0, 2.0], [1.0, 2.0, 3.0])


def test_displayed_is_what_mitsuba_writes_to_8_bits() -> None:
    pytest.importorskip("mitsuba").set_variant("llvm_ad_rgb")
    ramp = np.linspace(-0.2, 1.4, 64, dtype=np.float32).reshape(8, 8, 1).repeat(3, axis=2)
    assert np.abs(255 * metrics.displayed(ramp) - to_srgb8(ramp)).max() < 1
