"""Size of the bias per pixel: the product of independent chains, in which noise cancels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .images import FloatArray, luminance, runs_luminance, smoothed_reference
from .intervals import Interval, Jackknife, jackknife, mean_interval


def _relative_chains(
    chains: ArrayLike, reference: ArrayLike, sigma: float, epsilon: float
) -> tuple[FloatArray, FloatArray]:
    y, r = runs_luminance(chains), luminance(reference)
    if y.shape[1:] != r.shape:
        raise ValueError(f"Chains have {y.shape[1:]} pixels but the reference has {r.shape}.")
    if y.shape[0] < 2:
        raise ValueError("The bias per pixel needs at least 2 independent chains.")
    scale = smoothed_reference(r, sigma=sigma, epsilon=epsilon)
    return (y - r) / scale, scale


def squared_pixel_bias(
    chains: ArrayLike,
    reference: ArrayLike,
    reference_variance: ArrayLike = 0.0,
    *,
    mask: ArrayLike | None = None,
    sigma: float = 8.0,
    epsilon: float = 0.01,
    level: float = 0.95,
) -> Interval:
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
    reference_variance : array_like
        Variance of the *luminance* of the reference, (H, W) or a number.
    mask : array_like of bool, (H, W), optional
        Look only here, e.g. at shadow edges or the brightest 1 %.
    sigma, epsilon : float
        Of `smoothed_reference`, by which errors are divided.
    level : float
        Coverage of the jackknife interval over chains (infinitely wide for two chains).

    Returns
    -------
    Interval
        In squared relative units: 1e-4 is an rms bias of 1 %.
    """
    found = pixel_bias_jackknife(
        chains, reference, reference_variance, mask=mask, sigma=sigma, epsilon=epsilon
    )
    if found.left_out.size == 2:
        return Interval(found.value, -np.inf, np.inf, np.inf, level)
    return found.interval(level=level)


def pixel_bias_jackknife(
    chains: ArrayLike,
    reference: ArrayLike,
    reference_variance: ArrayLike = 0.0,
    *,
    mask: ArrayLike | None = None,
    sigma: float = 8.0,
    epsilon: float = 0.01,
) -> Jackknife:
    """Mean squared relative bias of all chains and of all but each; as `squared_pixel_bias`."""
    errors, scale = _relative_chains(chains, reference, sigma, epsilon)
    known = np.broadcast_to(np.asarray(reference_variance, dtype=np.float64), scale.shape)
    inside = np.ones(scale.shape, dtype=bool) if mask is None else np.asarray(mask, dtype=bool)
    if inside.shape != scale.shape or not inside.any():
        raise ValueError(f"The mask needs shape {scale.shape} and at least one pixel.")
    picked = errors[:, inside]
    floor = float(np.mean((known / scale**2)[inside]))

    def cross(chosen: FloatArray) -> float:
        count = chosen.shape[0]
        both = np.sum(chosen.sum(axis=0) ** 2) - np.sum(chosen**2)
        return float(both / (count * (count - 1) * chosen.shape[1])) - floor

    if picked.shape[0] == 2:
        return Jackknife(cross(picked), np.full(2, np.nan))
    return jackknife(picked, cross)


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
