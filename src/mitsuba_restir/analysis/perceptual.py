"""Perceptual error: what is left of an error seen from a distance, through a Gaussian."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from .images import finite


def filtered_mse(error: ArrayLike, sigma: float, *, periodic: bool = False) -> float:
    """
    Mean square of the error seen through a Gaussian, mean((g_sigma * e)²).

    Parameters
    ----------
    error : array_like, (H, W) or (F, H, W)
        Error images; the mean is over all frames.
    sigma : float
        Standard deviation in pixels; 1.5 is about what the eye does to pixels of a screen.
    periodic : bool
        The image repeats (a mask); else its border is mirrored.
    """
    e = finite(error, "The error", (2, 3))
    sigmas = (0.0, sigma, sigma)[3 - e.ndim :]
    seen = ndimage.gaussian_filter(e, sigmas, mode="wrap" if periodic else "reflect")
    return float(np.mean(seen**2))


def filtered_share(error: ArrayLike, sigma: float, *, periodic: bool = False) -> float:
    """
    Filtered MSE over what white noise of equal variance would have.

    1 for white noise, below 1 for blue noise, above 1 for blotches.
    """
    e = finite(error, "The error", (2, 3))
    size = 2 * int(4.0 * sigma + 0.5) + 1
    impulse = np.zeros((size, size))
    impulse[size // 2, size // 2] = 1.0
    kernel = ndimage.gaussian_filter(impulse, sigma, mode="constant")
    return filtered_mse(e, sigma, periodic=periodic) / float(np.mean(e**2) * np.sum(kernel**2))
