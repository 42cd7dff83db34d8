"""Size of the bias per pixel: the product of independent chains, in which noise cancels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .images import FloatArray, luminance, runs_luminance, smoothed_reference
from .intervals import Interval, Jackknife, jackknife, mean_interval

__all__ = ["mean_bias", "squared_pixel_bias"]


def squared_pixel_bias(
    chains: ArrayLike, reference: ArrayLike, reference_variance: ArrayLike = 0.0
) -> Jackknife:
    """
    Mean over pixels of (A - R)(B - R), A and B different chains: the mean squared relative bias.

    With more than two chains, the mean over all pairs. The noise of the chains cancels, that of the
    reference does not (it is common to both), so its known variance is subtracted. Take the root
    of a clearly positive value for the rms bias; a negative one means that none was seen.

    Parameters
    ----------
    chains : array_like, (K, H, W) or (K, H, W, C)
        Mean of the frames of each of K >= 2 independent chains.
    reference : array_like, (H, W) or (H, W, C)
        Errors are divided by it, smoothed (`smoothed_reference`).
    reference_variance : array_like
        Variance of the *luminance* of the reference, (H, W) or a number.

    Returns
    -------
    Jackknife
        In squared relative units: 1e-4 is an rms bias of 1 %. Two chains give no interval.
    """
    y, r = runs_luminance(chains), luminance(reference)
    if y.shape[1:] != r.shape:
        raise ValueError(f"Chains have {y.shape[1:]} pixels but the reference has {r.shape}.")
    if y.shape[0] < 2:
        raise ValueError("The bias per pixel needs at least 2 independent chains.")
    scale = smoothed_reference(r)
    # The chains of a pixel side by side, as they are summed.
    errors = np.asfortranarray(((y - r) / scale).reshape(len(y), -1))
    floor = float(np.mean(np.asarray(reference_variance, dtype=np.float64) / scale**2))

    def cross(chosen: FloatArray) -> float:
        count = chosen.shape[0]
        both = np.sum(chosen.sum(axis=0) ** 2) - np.sum(chosen**2)
        return float(both / (count * (count - 1) * chosen.shape[1])) - floor

    if len(errors) == 2:
        return Jackknife(cross(errors), np.full(2, np.nan))
    return jackknife(errors, cross)


def mean_bias(chains: ArrayLike, baseline: ArrayLike, *, level: float = 0.95) -> Interval:
    """
    Relative difference of mean luminance from a baseline on the same frames.

    Paired: a display pass and the plain average of the same frames share nearly all of their noise,
    so that far smaller differences are seen than against a reference.

    Parameters
    ----------
    chains, baseline : array_like, (K, H, W) or (K, H, W, C)
        Mean of the frames of each chain; chain k of both comes from the same frames.
    """
    y, b = runs_luminance(chains), runs_luminance(baseline)
    if y.shape != b.shape:
        raise ValueError(f"Chains have shape {y.shape} but the baseline has {b.shape}.")
    mean = float(b.mean())
    if not mean > 0.0:
        raise ValueError("The baseline is black: a relative difference is not defined.")
    return mean_interval((y - b).mean(axis=(1, 2)) / mean, level=level)
