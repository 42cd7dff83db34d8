"""Relative covariance as an image: per pixel, about one pixel, and by lag.

Definitions as in `covariance`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from .covariance_products import check_radius, relative_deviations, window_counts, window_sums
from .images import FloatArray


def covariance_map(
    runs: ArrayLike,
    reference: ArrayLike,
    *,
    radius: int = 8,
    sigma: float = 8.0,
    epsilon: float = 0.01,
) -> FloatArray:
    """
    Mean relative covariance of each pixel with its neighbourhood, without itself.

    The mean of this image is `relative_covariance(...).covariance.value`.

    Returns
    -------
    ndarray, (H, W)
    """
    check_radius(radius)
    d = relative_deviations(runs, reference, sigma=sigma, epsilon=epsilon)
    others = window_sums(d, radius) - d
    counts = np.maximum(window_counts(d.shape[1:], radius) - 1.0, 1.0)
    return np.asarray((d * others).sum(axis=0) / counts / (d.shape[0] - 1))


def pixel_covariance(
    runs: ArrayLike,
    reference: ArrayLike,
    pixel: tuple[int, int],
    *,
    sigma: float = 8.0,
    epsilon: float = 0.01,
) -> FloatArray:
    """
    Relative covariance of one pixel with every pixel of the image.

    Parameters
    ----------
    pixel : (int, int)
        Row and column.

    Returns
    -------
    ndarray, (H, W)
    """
    d = relative_deviations(runs, reference, sigma=sigma, epsilon=epsilon)
    row, column = pixel
    if not (0 <= row < d.shape[1] and 0 <= column < d.shape[2]):
        raise ValueError(f"Pixel {pixel} is outside the image of {d.shape[1:]} pixels.")
    return np.asarray(np.tensordot(d[:, row, column], d, axes=1) / (d.shape[0] - 1))


def lag_covariance(
    runs: ArrayLike,
    reference: ArrayLike,
    *,
    radius: int = 8,
    sigma: float = 8.0,
    epsilon: float = 0.01,
) -> FloatArray:
    """
    Relative covariance by lag: mean over all pairs of pixels with the same offset.

    Returns
    -------
    ndarray, (2 radius + 1, 2 radius + 1)
        Entry (radius + dy, radius + dx); the centre is the mean variance. Symmetric about it.
    """
    products = lag_products(runs, reference, radius=radius, sigma=sigma, epsilon=epsilon)
    return np.asarray(products.sum(axis=0) / (len(products) - 1))


def lag_products(
    runs: ArrayLike,
    reference: ArrayLike,
    *,
    radius: int = 8,
    sigma: float = 8.0,
    epsilon: float = 0.01,
) -> FloatArray:
    """
    Mean product of the deviations of two pixels by lag, for each run.

    Their sum A over K runs, divided by K - 1, is `lag_covariance`; (A - A_k K / (K - 1)) / (K - 2)
    is that of all runs but k, since the deviations from the mean without run k are
    d_i + d_k / (K - 1).

    Returns
    -------
    ndarray, (K, 2 radius + 1, 2 radius + 1)
    """
    check_radius(radius)
    d = relative_deviations(runs, reference, sigma=sigma, epsilon=epsilon)
    height, width = d.shape[1:]
    if radius >= min(height, width):
        raise ValueError(f"The radius {radius} does not fit into {height}x{width} pixels.")
    # Padded, the circular products up to the radius are the plain ones.
    shape = (height + radius, width + radius)
    sums = np.stack([fft.irfft2(np.abs(fft.rfft2(image, shape)) ** 2, shape) for image in d])
    lags = np.arange(-radius, radius + 1)
    pairs = np.outer(height - np.abs(lags), width - np.abs(lags))
    return np.asarray(sums[:, lags[:, None], lags[None, :]] / pairs)
