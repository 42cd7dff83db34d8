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

from .covariance_products import (
    RunProducts,
    bootstrap_draws,
    quadratic,
    relative_deviations,
    run_products,
)
from .images import FloatArray, finite
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
    products = run_products([runs], reference, radius=radius, sigma=sigma, epsilon=epsilon)
    return covariance_of_products(products, level=level, resamples=resamples, seed=seed)


def covariance_of_products(
    products: RunProducts, *, level: float = 0.95, resamples: int = 2000, seed: int = 0
) -> RelativeCovariance:
    """Mean relative covariance from the inner products of runs; as `relative_covariance`."""
    count = products.runs
    values = products.draws(np.ones((1, count)))
    draws = bootstrap_draws(products, resample_counts(count, resamples, seed))
    covariance, with_self, variance = (
        percentile_interval(float(value[0]), draw, level=level)
        for value, draw in zip(values, draws, strict=True)
    )
    correlation = percentile_interval(
        float(_over(values[0], values[2])[0]), _over(draws[0], draws[2]), level=level
    )
    return RelativeCovariance(covariance, with_self, variance, correlation, products.radius, count)


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
    one, two = (
        run_products([runs], reference, radius=radius, sigma=sigma, epsilon=epsilon)
        for runs in (first, second)
    )
    return ratio_of_products(one, two, paired=paired, level=level, resamples=resamples, seed=seed)


def ratio_of_products(
    first: RunProducts,
    second: RunProducts,
    *,
    paired: bool = True,
    level: float = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> Interval:
    """Ratio of two covariances from the inner products of runs; as `covariance_ratio`."""
    if paired and first.runs != second.runs:
        raise ValueError(
            f"Paired variants need equal numbers of runs, not {first.runs}, {second.runs}."
        )
    both = (first, second)
    values = [products.draws(np.ones((1, products.runs)))[0] for products in both]
    draws = [
        bootstrap_draws(
            products, resample_counts(products.runs, resamples, seed if paired else seed + index)
        )[0]
        for index, products in enumerate(both)
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
    value = float(quadratic(gram, np.ones((1, runs)))[0])
    draws = quadratic(gram, resample_counts(runs, resamples, seed)) * runs / (runs - 1)
    return percentile_interval(value, draws, level=level)
