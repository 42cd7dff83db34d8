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

from .covariance_products import RunProducts, jackknife_of, relative_deviations, run_products
from .images import FloatArray, finite
from .intervals import Interval, Jackknife


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
) -> RelativeCovariance:
    """
    Mean relative covariance within a window, with jackknife intervals over runs.

    Parameters
    ----------
    runs : array_like, (K, H, W) or (K, H, W, C)
        Independent images; two give no interval.
    reference : array_like, (H, W) or (H, W, C)
        Only its smoothed luminance is used.
    radius : int
        The window is (2 radius + 1)² pixels; at the border, the part of it inside the image.
    sigma, epsilon : float
        Of `smoothed_reference`.
    level : float
        Coverage of the intervals.
    """
    products = run_products([runs], reference, radius=radius, sigma=sigma, epsilon=epsilon)
    return covariance_of_products(products, level=level)


def covariance_of_products(products: RunProducts, *, level: float = 0.95) -> RelativeCovariance:
    """Mean relative covariance from the inner products of runs; as `relative_covariance`."""
    grams = (products.window_term, products.with_self, products.self_term)
    covariance, with_self, variance = (jackknife_of(gram).interval(level=level) for gram in grams)
    correlation = correlation_of_products(products).interval(level=level)
    return RelativeCovariance(
        covariance, with_self, variance, correlation, products.radius, products.runs
    )


def correlation_of_products(products: RunProducts) -> Jackknife:
    """Mean correlation (covariance over variance) of runs and of all but each."""
    covariance, variance = (jackknife_of(g) for g in (products.window_term, products.self_term))
    values, below = (np.append(j.left_out, j.value) for j in (covariance, variance))
    ratios = np.divide(values, below, out=np.full_like(values, np.nan), where=below != 0.0)
    return Jackknife(float(ratios[-1]), ratios[:-1])


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
) -> Interval:
    """
    Relative covariance of one variant over that of another (without the term j = i).

    Parameters
    ----------
    first, second : array_like, (K, H, W) or (K, H, W, C)
        Independent images of the two variants.
    paired : bool
        Run m of both has the same seeds: the jackknife then leaves the same run out of both.
    reference, radius, sigma, epsilon, level
        As in `relative_covariance`.
    """
    one, two = (
        run_products([runs], reference, radius=radius, sigma=sigma, epsilon=epsilon)
        for runs in (first, second)
    )
    return ratio_of_products(one, two, paired=paired, level=level)


def ratio_of_products(
    first: RunProducts, second: RunProducts, *, paired: bool = True, level: float = 0.95
) -> Interval:
    """Ratio of two covariances from the inner products of runs; as `covariance_ratio`."""
    if paired and first.runs != second.runs:
        raise ValueError(
            f"Paired variants need equal numbers of runs, not {first.runs}, {second.runs}."
        )
    own, base = (jackknife_of(products.window_term) for products in (first, second))
    return own.over(base, paired=paired, level=level)


def temporal_covariance(
    sequences: ArrayLike,
    reference: ArrayLike,
    *,
    lag: int = 1,
    sigma: float = 8.0,
    epsilon: float = 0.01,
    level: float = 0.95,
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
    sigma, epsilon, level
        As in `relative_covariance`.
    """
    products = temporal_products(sequences, reference, lag=lag, sigma=sigma, epsilon=epsilon)
    return jackknife_of(products).interval(level=level)


def temporal_products(
    sequences: ArrayLike,
    reference: ArrayLike,
    *,
    lag: int = 1,
    sigma: float = 8.0,
    epsilon: float = 0.01,
) -> FloatArray:
    """Inner products (K, K) of runs, one `lag` frames after the other; as `temporal_covariance`."""
    x = finite(sequences, "The sequences", (4, 5))
    if not 0 <= lag < x.shape[1]:
        raise ValueError(f"A lag of {lag} frames needs more than {x.shape[1]} frames.")
    frames = [
        relative_deviations(x[:, t], reference, sigma=sigma, epsilon=epsilon).reshape(len(x), -1)
        for t in range(x.shape[1])
    ]
    pairs = [(frames[t], frames[t + lag]) for t in range(len(frames) - lag)]
    return np.asarray(np.mean([a @ b.T / a.shape[1] for a, b in pairs], axis=0))
