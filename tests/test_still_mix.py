"""Mixtures of a frame's estimates: unbiased by weights of earlier frames, never much worse."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mitsuba_restir.still.mix import mixture

SHAPE = (24, 32)
DECISIONS = (4, 5, 7, 9, 12)
LAST_ALONE = np.array([0.0, 0.0, 1.0])


def covariance(frames: np.ndarray) -> np.ndarray:
    """(N, K, H, W) -> (K, K, H, W)."""
    deviation = frames - frames.mean(axis=0)
    return np.einsum("nihw,njhw->ijhw", deviation, deviation) / (len(frames) - 1)


def rare(rng, count: int, chance: float, shape=SHAPE) -> np.ndarray:
    """Light that is found with a chance and then has an exponential tail of its own; mean 1."""
    return (rng.random((count, *shape)) < chance) * rng.exponential(1 / chance, (count, *shape))


def heavy(rng, count: int) -> np.ndarray:
    """Three estimates of a picture of ones, (N, 3, H, W): correlated, all with heavy tails."""
    candidates = rare(rng, count, 0.1)
    first = 0.5 * candidates + 0.5 * rare(rng, count, 0.2)
    last = 0.3 * first + 0.7 * rare(rng, count, 0.15)
    return np.stack([candidates, first, last], axis=1)


def mixed(frames: np.ndarray, weights_of) -> np.ndarray:
    """Mean of a picture whose weights are renewed at decision points."""
    weights, total = LAST_ALONE[:, None, None], 0
    for index, frame in enumerate(frames):
        if index in DECISIONS:
            weights = weights_of(frames, index)
        total = total + (weights * frame).sum(axis=0)
    return total / len(frames)


def error_of_the_mean(weights_of, pictures: int = 60) -> tuple[float, float]:
    """Mean error over pictures and pixels, and p-value of its being 0 (the picture is the unit)."""
    rng = np.random.default_rng(5)
    errors = [mixed(heavy(rng, 16), weights_of).mean() - 1 for _ in range(pictures)]
    return float(np.mean(errors)), float(stats.ttest_1samp(errors, 0).pvalue)


def test_weights_of_earlier_frames_do_not_bias():
    """False-alarm rate 1e-4; an error of 0.5 % would be found (see the control)."""
    error, p = error_of_the_mean(lambda frames, index: mixture(covariance(frames[:index]), index))
    assert p > 1e-4, error
    assert abs(error) < 0.005


def test_control_weights_of_the_same_frames_bias():
    """Those that a picture of the same frames would be mixed with: darker, beyond any doubt."""
    error, p = error_of_the_mean(
        lambda frames, index: mixture(covariance(frames[index : index + 4]), 4)
    )
    assert p < 1e-8
    assert error < -0.005


@pytest.mark.parametrize("frames", [4, 16, 64])
def test_variance_is_never_much_above_the_best(frames):
    """At most 10 % on the mean of a region (a Gaussian blurs its border), against the truth.

    Left, the candidates are best, right the last round, and in the middle all are alike.
    """
    rng = np.random.default_rng(7)
    scale = np.ones((3, *SHAPE))
    scale[1:, :, :11] = 2
    scale[:2, :, 22:] = 2
    weights = np.mean(
        [
            mixture(covariance(scale * rng.gamma(0.25, 4.0, (frames, 3, *SHAPE))), frames)
            for _ in range(8)
        ],
        axis=0,
    )
    variance = ((weights * scale) ** 2).sum(axis=0)
    best = (scale**2).min(axis=0)
    for columns in (slice(0, 11), slice(11, 22), slice(22, None)):
        assert variance[:, columns].mean() < 1.1 * best[:, columns].mean()


def test_four_frames_with_heavy_tails_do_no_harm():
    """Candidates find light once in 300: most pixels of four frames say that they are perfect."""
    rng = np.random.default_rng(9)
    chance, reused = 1 / 300, np.array([[1, 0], [0.3, 0.7], [0, 1]])
    true = reused @ np.diag([2 / chance - 1, 0.5]) @ reused.T
    for _ in range(10):
        independent = [rare(rng, 4, chance), rng.gamma(2.0, 0.5, (4, *SHAPE))]
        frames = np.einsum("ij,jnhw->nihw", reused, independent)
        weights = mixture(covariance(frames), 4)
        variance = np.einsum("ihw,ij,jhw->hw", weights, true, weights)
        assert variance.mean() < 1.02 * true[-1, -1]


@pytest.mark.parametrize("estimates", [1, 2, 3])
def test_weights_are_shares(estimates):
    frames = heavy(np.random.default_rng(3), 8)[:, 3 - estimates :]
    weights = mixture(covariance(frames), 8)
    assert weights.shape == (estimates, *SHAPE)
    assert weights.min() >= 0
    assert weights.max() <= 1
    np.testing.assert_allclose(weights.sum(axis=0), 1, rtol=1e-12)


def test_a_black_picture_keeps_the_last_round():
    weights = mixture(np.zeros((3, 3, *SHAPE)), 4)
    np.testing.assert_array_equal(weights, np.broadcast_to(LAST_ALONE[:, None, None], (3, *SHAPE)))


def test_black_pixels_and_equal_estimates_are_no_trouble():
    """Half of the image is black; with one round the first is the last."""
    measured = covariance(heavy(np.random.default_rng(4), 8))
    measured[..., :16] = 0
    equal = measured[[0, 2, 2]][:, [0, 2, 2]]
    for each in (measured, equal):
        with np.errstate(all="raise", under="ignore"):
            weights = mixture(each, 8)
        assert np.isfinite(weights).all()
        np.testing.assert_allclose(weights.sum(axis=0), 1, rtol=1e-12)


def test_scale_and_units_do_not_matter():
    measured = covariance(heavy(np.random.default_rng(6), 8))
    np.testing.assert_allclose(mixture(1e-8 * measured, 8), mixture(measured, 8), atol=1e-6)
