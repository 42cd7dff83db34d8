"""Relative covariance between pixels and between frames, over independent runs.

c_ij = 1/(K-1) sum_m (I_mi - mean_i)(I_mj - mean_j) over K independent runs of the luminance I;
relative covariance is c_ij / (R_i R_j), with R the smoothed reference plus a constant
(`images.smoothed_reference`). Consecutive frames of one run are no independent runs: their mean is
not the expectation, and the covariance comes out too small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from .images import FloatArray, finite, runs_luminance, smoothed_reference
from .intervals import Interval, percentile_interval, resample_counts


@dataclass(frozen=True)
class RelativeCovariance:
    """
    Mean relative covariance of a pixel with its neighbourhood, over all pixels.

    Fields
    ------
    covariance : Interval
        Mean over the window without the pixel itself.
    with_self : Interval
        The same with the pixel's own variance in the mean.
    variance : Interval
        Mean relative variance (the term j = i alone).
    normalised : Interval
        `covariance` over `variance`: the mean correlation. Unlike the covariance, it does not fall
        merely because the variance falls.
    radius, runs : int
        The window has (2 radius + 1)² pixels (fewer at the image's border); number of runs K.
    """

    covariance: Interval
    with_self: Interval
    variance: Interval
    normalised: Interval
    radius: int
    runs: int


def relative_deviations(
    runs: ArrayLike, reference: ArrayLike, *, sigma: float = 8.0, epsilon: float = 0.01
) -> FloatArray:
    """
    Deviations of the runs from their mean, relative to the smoothed reference.

    Parameters
    ----------
    runs : array_like, (K, H, W) or (K, H, W, C)
        Independent images.
    reference : array_like, (H, W) or (H, W, C)
    sigma, epsilon : float
        Of `smoothed_reference`.

    Returns
    -------
    ndarray, (K, H, W)

    Raises
    ------
    ValueError
        If there are fewer than 2 runs or the shapes do not fit.
    """
    y = runs_luminance(runs)
    r = smoothed_reference(reference, sigma=sigma, epsilon=epsilon)
    if y.shape[1:] != r.shape:
        raise ValueError(f"Runs have {y.shape[1:]} pixels but the reference has {r.shape}.")
    if y.shape[0] < 2:
        raise ValueError("A covariance needs at least 2 independent runs.")
    return (y - y.mean(axis=0)) / r


def window_sums(images: FloatArray, radius: int) -> FloatArray:
    """Sum over the (2 radius + 1)² window of each pixel of (K, H, W), zero outside the image."""
    size = 2 * radius + 1
    mean = ndimage.uniform_filter(images, (1, size, size), mode="constant")
    return np.asarray(mean * size**2)


def window_counts(shape: tuple[int, ...], radius: int) -> FloatArray:
    """Number of pixels of an (H, W) image inside the window of each pixel."""
    return np.rint(window_sums(np.ones((1, *shape)), radius)[0])


def check_radius(radius: int) -> None:
    """Refuse a window without neighbours (ValueError)."""
    if radius < 1:
        raise ValueError(f"The radius must be at least 1 pixel, not {radius}.")


@dataclass(frozen=True)
class _Gram:
    """Inner products of the runs, from which every resample's covariance follows exactly."""

    self_term: FloatArray
    window_term: FloatArray
    with_self: FloatArray

    @staticmethod
    def of(deviations: FloatArray, radius: int) -> _Gram:
        runs, pixels = deviations.shape[0], deviations[0].size
        flat = deviations.reshape(runs, -1)
        sums = window_sums(deviations, radius)
        counts = window_counts(deviations.shape[1:], radius)
        others = ((sums - deviations) / np.maximum(counts - 1.0, 1.0)).reshape(runs, -1)
        everyone = (sums / counts).reshape(runs, -1)
        return _Gram(flat @ flat.T / pixels, flat @ others.T / pixels, flat @ everyone.T / pixels)

    def draws(self, counts: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Covariance, covariance with self and variance of each resample (row of counts)."""
        return (
            _quadratic(self.window_term, counts),
            _quadratic(self.with_self, counts),
            _quadratic(self.self_term, counts),
        )


def _quadratic(gram: FloatArray, counts: FloatArray) -> FloatArray:
    """
    Sample covariance of resampled runs, 1/(K-1) (sum_m w_m G_mm - w'Gw / K).

    With w = 1 this is the covariance itself. A resample repeats runs, which makes its covariance
    smaller by (K-1)/K in the mean; callers that resample undo that.
    """
    runs = gram.shape[0]
    squares = np.einsum("bm,mn,bn->b", counts, gram, counts, optimize=True)
    return np.asarray((counts @ np.diag(gram) - squares / runs) / (runs - 1))


def _bootstrap(gram: _Gram, counts: FloatArray) -> tuple[FloatArray, ...]:
    runs = counts.shape[1]
    return tuple(d * runs / (runs - 1) for d in gram.draws(counts))


def relative_covariance(
    runs: ArrayLike,
    reference: ArrayLike,
    *,
    radius: int = 8,
    sigma: float = 8.0,
    epsilon: float = 0.01,
    level: float = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> RelativeCovariance:
    """
    Mean relative covariance within a window, with bootstrap intervals over runs.

    Parameters
    ----------
    runs : array_like, (K, H, W) or (K, H, W, C)
        Independent images; 32 or more for a usable interval.
    reference : array_like, (H, W) or (H, W, C)
        Only its smoothed luminance is used.
    radius : int
        The window is (2 radius + 1)² pixels; at the border, the part of it inside the image.
    sigma, epsilon : float
        Of `smoothed_reference`.
    level, resamples, seed
        Of the bootstrap.
    """
    check_radius(radius)
    gram = _Gram.of(relative_deviations(runs, reference, sigma=sigma, epsilon=epsilon), radius)
    count = gram.self_term.shape[0]
    values = gram.draws(np.ones((1, count)))
    draws = _bootstrap(gram, resample_counts(count, resamples, seed))
    covariance, with_self, variance = (
        percentile_interval(float(value[0]), draw, level=level)
        for value, draw in zip(values, draws, strict=True)
    )
    correlation = percentile_interval(
        float(_over(values[0], values[2])[0]), _over(draws[0], draws[2]), level=level
    )
    return RelativeCovariance(covariance, with_self, variance, correlation, radius, count)


def _over(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.divide(first, second, out=np.full_like(first, np.nan), where=second != 0.0)


def covariance_ratio(
    first: ArrayLike,
    second: ArrayLike,
    reference: ArrayLike,
    *,
    radius: int = 8,
    paired: bool = True,
    sigma: float = 8.0,
    epsilon: float = 0.01,
    level: float = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> Interval:
    """
    Relative covariance of one variant over that of another (without the term j = i).

    Parameters
    ----------
    first, second : array_like, (K, H, W) or (K, H, W, C)
        Independent images of the two variants.
    paired : bool
        Run m of both has the same seeds: the bootstrap then draws the same runs of both.
    reference, radius, sigma, epsilon, level, resamples, seed
        As in `relative_covariance`.
    """
    check_radius(radius)
    grams = [
        _Gram.of(relative_deviations(runs, reference, sigma=sigma, epsilon=epsilon), radius)
        for runs in (first, second)
    ]
    sizes = [gram.self_term.shape[0] for gram in grams]
    if paired and sizes[0] != sizes[1]:
        raise ValueError(f"Paired variants need equal numbers of runs, not {sizes[0]}, {sizes[1]}.")
    values = [g.draws(np.ones((1, n)))[0] for g, n in zip(grams, sizes, strict=True)]
    draws = [
        _bootstrap(gram, resample_counts(size, resamples, seed if paired else seed + index))[0]
        for index, (gram, size) in enumerate(zip(grams, sizes, strict=True))
    ]
    return percentile_interval(float(_over(*values)[0]), _over(*draws), level=level)


def temporal_covariance(
    sequences: ArrayLike,
    reference: ArrayLike,
    *,
    lag: int = 1,
    sigma: float = 8.0,
    epsilon: float = 0.01,
    level: float = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> Interval:
    """
    Relative covariance of a pixel in frames t and t + lag, mean over pixels and t.

    Parameters
    ----------
    sequences : array_like, (K, T, H, W) or (K, T, H, W, C)
        Luminance or colour of T consecutive frames of K independent runs.
    reference : array_like, (H, W) or (H, W, C)
        Only its smoothed luminance is used.
    lag : int
        Frames between the two; 0 gives the mean relative variance.
    sigma, epsilon, level, resamples, seed
        As in `relative_covariance`.
    """
    x = finite(sequences, "The sequences", (4, 5))
    if not 0 <= lag < x.shape[1]:
        raise ValueError(f"A lag of {lag} frames needs more than {x.shape[1]} frames.")
    frames = [
        relative_deviations(x[:, t], reference, sigma=sigma, epsilon=epsilon).reshape(len(x), -1)
        for t in range(x.shape[1])
    ]
    pairs = [(frames[t], frames[t + lag]) for t in range(len(frames) - lag)]
    gram = np.mean([a @ b.T / a.shape[1] for a, b in pairs], axis=0)
    runs = gram.shape[0]
    value = float(_quadratic(gram, np.ones((1, runs)))[0])
    draws = _quadratic(gram, resample_counts(runs, resamples, seed)) * runs / (runs - 1)
    return percentile_interval(value, draws, level=level)
