"""Relative covariance between pixels and between frames, over independent runs.

c_ij = 1/(K-1) sum_m (I_mi - mean_i)(I_mj - mean_j) over K independent runs of the luminance I;
relative covariance is c_ij / (R_i R_j), with R the smoothed reference plus a constant
(`images.smoothed_reference`). Consecutive frames of one run are no independent runs: their mean is
not the expectation, and the covariance comes out too small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from .images import FloatArray, finite, runs_luminance, smoothed_reference
from .intervals import Jackknife

__all__ = ["RunProducts", "relative_deviations", "run_products", "temporal_covariance"]


def relative_deviations(runs: ArrayLike, reference: ArrayLike) -> FloatArray:
    """
    Deviations of the runs from their mean, relative to the smoothed reference.

    Parameters
    ----------
    runs : array_like, (K, H, W) or (K, H, W, C)
        Independent images.
    reference : array_like, (H, W) or (H, W, C)

    Returns
    -------
    ndarray, (K, H, W)

    Raises
    ------
    ValueError
        If there are fewer than 2 runs or the shapes do not fit.
    """
    y, r = runs_luminance(runs), smoothed_reference(reference)
    if y.shape[1:] != r.shape:
        raise ValueError(f"Runs have {y.shape[1:]} pixels but the reference has {r.shape}.")
    if y.shape[0] < 2:
        raise ValueError("A covariance needs at least 2 independent runs.")
    return (y - y.mean(axis=0)) / r


def neighbour_means(images: FloatArray, radius: int) -> tuple[FloatArray, FloatArray]:
    """
    Mean over the window of each pixel of (K, H, W): without the pixel itself, and with it.

    The window has (2 radius + 1)² pixels, at the border the part of them inside the image.
    """
    if radius < 1:
        raise ValueError(f"The radius must be at least 1 pixel, not {radius}.")
    size = 2 * radius + 1

    def sums(values: FloatArray) -> FloatArray:
        mean = ndimage.uniform_filter(values, (1, size, size), mode="constant")
        return np.asarray(mean * size**2)

    total, counts = sums(images), np.rint(sums(np.ones((1, *images.shape[1:]))))
    return (total - images) / np.maximum(counts - 1.0, 1.0), total / counts


@dataclass(frozen=True)
class RunProducts:
    """
    Inner products of K runs, from which the covariance of any of them follows exactly.

    Fields
    ------
    own, others, everyone : ndarray, (K, K)
        Of the deviations with themselves, with their neighbourhoods' means without the pixel
        itself, and with the pixel itself.
    """

    own: FloatArray
    others: FloatArray
    everyone: FloatArray

    @property
    def covariance(self) -> Jackknife:
        """Mean relative covariance of a pixel with its neighbourhood, without itself."""
        return jackknife_of(self.others)

    @property
    def with_self(self) -> Jackknife:
        """The same with the pixel's own variance in the mean."""
        return jackknife_of(self.everyone)

    @property
    def variance(self) -> Jackknife:
        """Mean relative variance (the term j = i alone)."""
        return jackknife_of(self.own)

    @property
    def correlation(self) -> Jackknife:
        """
        Covariance over variance.

        Unlike the covariance, it does not fall merely because the variance falls.
        """
        above, below = (np.append(j.left_out, j.value) for j in (self.covariance, self.variance))
        ratios = np.divide(above, below, out=np.full_like(above, np.nan), where=below != 0.0)
        return Jackknife(float(ratios[-1]), ratios[:-1])


def run_products(
    frames: Sequence[ArrayLike], reference: ArrayLike, *, radius: int = 8
) -> RunProducts:
    """
    Inner products of runs, mean over the frames of a run.

    Parameters
    ----------
    frames : sequence of array_like, (K, H, W) or (K, H, W, C) each
        Images of K independent runs: frame t of all of them is one entry. The covariance is that
        between runs at the same t, so frames of one run may depend on each other.
    reference : array_like, (H, W) or (H, W, C)
        Only its smoothed luminance is used.
    radius : int
        The neighbourhood is a window of (2 radius + 1)² pixels.
    """
    if not frames:
        raise ValueError("A covariance needs at least one frame.")
    terms = []
    for runs in frames:
        d = relative_deviations(runs, reference)
        flat = d.reshape(len(d), -1)
        terms.append(
            [
                flat @ other.reshape(flat.shape).T / flat.shape[1]
                for other in (d, *neighbour_means(d, radius))
            ]
        )
    own, others, everyone = np.mean(terms, axis=0)
    return RunProducts(own, others, everyone)


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


def temporal_covariance(sequences: ArrayLike, reference: ArrayLike, *, lag: int = 1) -> Jackknife:
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
    """
    x = finite(sequences, "The sequences", (4, 5))
    if not 0 <= lag < x.shape[1]:
        raise ValueError(f"A lag of {lag} frames needs more than {x.shape[1]} frames.")
    frames = [
        relative_deviations(x[:, t], reference).reshape(len(x), -1) for t in range(x.shape[1])
    ]
    pairs = [(frames[t], frames[t + lag]) for t in range(len(frames) - lag)]
    return jackknife_of(np.mean([a @ b.T / a.shape[1] for a, b in pairs], axis=0))
