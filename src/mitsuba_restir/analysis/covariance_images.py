"""Relative covariance as an image: of each pixel with its neighbours, and by lag.

Definitions as in `covariance`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from .covariance import neighbour_means, relative_deviations
from .images import FloatArray

__all__ = ["covariance_map"]


def covariance_map(runs: ArrayLike, reference: ArrayLike, *, radius: int = 8) -> FloatArray:
    """
    Mean relative covariance of each pixel with its neighbourhood, without itself.

    The mean of this image is that of `run_products`.

    Returns
    -------
    ndarray, (H, W)
    """
    d = relative_deviations(runs, reference)
    others, _ = neighbour_means(d, radius)
    return np.asarray((d * others).sum(axis=0) / (d.shape[0] - 1))


def lag_products(runs: ArrayLike, reference: ArrayLike, *, radius: int) -> FloatArray:
    """
    Mean product of the deviations of two pixels by lag, for each run.

    Their sum A over K runs, divided by K - 1, is the relative covariance by lag (the centre is the
    mean variance); (A - A_k K / (K - 1)) / (K - 2) is that of all runs but k, since the deviations
    from the mean without run k are d_i + d_k / (K - 1).

    Returns
    -------
    ndarray, (K, 2 radius + 1, 2 radius + 1)
        Entry (radius + dy, radius + dx).
    """
    d = relative_deviations(runs, reference)
    height, width = d.shape[1:]
    if radius >= min(height, width):
        raise ValueError(f"The radius {radius} does not fit into {height}x{width} pixels.")
    # Padded, the circular products up to the radius are the plain ones.
    shape = (height + radius, width + radius)
    sums = np.stack([fft.irfft2(np.abs(fft.rfft2(image, shape)) ** 2, shape) for image in d])
    lags = np.arange(-radius, radius + 1)
    pairs = np.outer(height - np.abs(lags), width - np.abs(lags))
    return np.asarray(sums[:, lags[:, None], lags[None, :]] / pairs)
