"""Inner products of independent runs: all that covariances and their jackknives are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from .images import FloatArray, runs_luminance, smoothed_reference
from .intervals import Jackknife


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
class RunProducts:
    """
    Inner products of K runs, from which the covariance of any of them follows exactly.

    Fields
    ------
    self_term, window_term, with_self : ndarray, (K, K)
        Of the deviations with themselves, with their neighbourhoods' means without the pixel
        itself, and with the pixel itself.
    radius : int
        The neighbourhood is a window of (2 radius + 1)² pixels.
    """

    self_term: FloatArray
    window_term: FloatArray
    with_self: FloatArray
    radius: int

    @property
    def runs(self) -> int:
        """Number of runs K."""
        return int(self.self_term.shape[0])


def run_products(
    frames: Sequence[ArrayLike],
    reference: ArrayLike,
    *,
    radius: int = 8,
    sigma: float = 8.0,
    epsilon: float = 0.01,
) -> RunProducts:
    """
    Inner products of runs, mean over the frames of a run.

    Parameters
    ----------
    frames : sequence of array_like, (K, H, W) or (K, H, W, C) each
        Images of K independent runs: frame t of all of them is one entry. The covariance is that
        between runs at the same t, so frames of one run may depend on each other.
    reference, radius, sigma, epsilon
        As in `relative_covariance`.
    """
    check_radius(radius)
    found = [
        _products(relative_deviations(runs, reference, sigma=sigma, epsilon=epsilon), radius)
        for runs in frames
    ]
    if not found:
        raise ValueError("A covariance needs at least one frame.")
    own, others, everyone = (np.mean(terms, axis=0) for terms in zip(*found, strict=True))
    return RunProducts(own, others, everyone, radius)


def _products(deviations: FloatArray, radius: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    runs, pixels = deviations.shape[0], deviations[0].size
    flat = deviations.reshape(runs, -1)
    sums = window_sums(deviations, radius)
    counts = window_counts(deviations.shape[1:], radius)
    others = ((sums - deviations) / np.maximum(counts - 1.0, 1.0)).reshape(runs, -1)
    everyone = (sums / counts).reshape(runs, -1)
    return flat @ flat.T / pixels, flat @ others.T / pixels, flat @ everyone.T / pixels


def jackknife_of(gram: FloatArray) -> Jackknife:
    """
    Sample covariance of runs and of all but each, from their inner products G (K, K).

    1/(n-1) (sum_m G_mm - sum_ml G_ml / n), over all runs m, l or all but one; n is their number.
    The mean that the deviations are from cancels, so that of all runs does for every choice.
    """
    runs = len(gram)
    trace, total = np.trace(gram), gram.sum()
    value = (trace - total / runs) / (runs - 1)
    if runs < 3:
        return Jackknife(float(value), np.full(runs, np.nan))
    traces = trace - np.diag(gram)
    totals = total - gram.sum(axis=0) - gram.sum(axis=1) + np.diag(gram)
    return Jackknife(float(value), (traces - totals / (runs - 1)) / (runs - 2))
