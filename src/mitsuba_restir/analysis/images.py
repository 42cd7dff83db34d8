"""Arrays as images: checks, luminance, and the smooth denominator of relative errors.

An image is a float array of shape (H, W) (luminance) or (H, W, C) with C = 1 or 3 (linear
Rec. 709). Several independent images are stacked in front: (K, H, W) or (K, H, W, C). All results
are float64.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

__all__ = ["luminance", "smoothed_reference"]

FloatArray: TypeAlias = NDArray[np.float64]

# The weights of mi.luminance, so that energies in the renderer and metrics here agree.
LUMINANCE_WEIGHTS = np.array([0.212671, 0.715160, 0.072169])


def finite(array: ArrayLike, name: str, ndims: tuple[int, ...]) -> FloatArray:
    """
    Convert to float64 and insist on the dimensions and on finite values.

    Parameters
    ----------
    array : array_like
        The values.
    name : str
        What the array is, for the error message.
    ndims : tuple of int
        The allowed numbers of dimensions.

    Raises
    ------
    ValueError
        If the number of dimensions is another one, the array is empty, or a value is not finite.
    """
    values = np.asarray(array, dtype=np.float64)
    if values.ndim not in ndims:
        allowed = " or ".join(str(n) for n in ndims)
        raise ValueError(f"{name} has shape {values.shape}: {allowed} dimensions are needed.")
    if values.size == 0:
        raise ValueError(f"{name} has shape {values.shape}: it is empty.")
    bad = int(values.size - np.count_nonzero(np.isfinite(values)))
    if bad:
        raise ValueError(f"{name} has {bad} values that are NaN or infinite.")
    return values


def image_pair(image: ArrayLike, reference: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """
    Check an image and its reference: finite, (H, W) or (H, W, C), and of one shape.

    Raises
    ------
    ValueError
        If a check fails.
    """
    a = finite(image, "The image", (2, 3))
    b = finite(reference, "The reference", (2, 3))
    if a.shape != b.shape:
        raise ValueError(f"The image has shape {a.shape} but the reference has {b.shape}.")
    return a, b


def variance_like(variance: ArrayLike | None, shape: tuple[int, ...]) -> FloatArray | float:
    """
    Check the variance of a reference of some shape: an array of that shape, a number, or None.

    Raises
    ------
    ValueError
        If the shape is another one, or a value is negative or not finite.
    """
    if variance is None:
        return 0.0
    values = finite(variance, "The reference variance", (0, 2, 3))
    if values.ndim and values.shape != shape:
        raise ValueError(
            f"The reference variance has shape {values.shape} but the reference has {shape}."
        )
    if np.any(values < 0.0):
        raise ValueError("The reference variance has negative values.")
    return values


def channels_luminance(array: ArrayLike) -> FloatArray:
    """
    Luminance of an array whose last axis is colour (3 channels, or 1 that is luminance already).

    Raises
    ------
    ValueError
        If the last axis has neither 1 nor 3 channels.
    """
    values = np.asarray(array, dtype=np.float64)
    channels = values.shape[-1] if values.ndim else 0
    if channels == 1:
        return values[..., 0]
    if channels != 3:
        raise ValueError(f"Colour needs 1 or 3 channels in the last axis, not {channels}.")
    return np.asarray(values @ LUMINANCE_WEIGHTS)


def luminance(image: ArrayLike) -> FloatArray:
    """
    Rec. 709 luminance of an image, with the weights of ``mi.luminance``.

    Parameters
    ----------
    image : array_like, (H, W) or (H, W, C)
        An (H, W) array is luminance already and is returned as it is.

    Returns
    -------
    ndarray, (H, W)
    """
    values = finite(image, "The image", (2, 3))
    return values if values.ndim == 2 else channels_luminance(values)


def runs_luminance(runs: ArrayLike) -> FloatArray:
    """
    Luminance of K independent images.

    Parameters
    ----------
    runs : array_like, (K, H, W) or (K, H, W, C)

    Returns
    -------
    ndarray, (K, H, W)
    """
    values = finite(runs, "The stack of runs", (3, 4))
    return values if values.ndim == 3 else channels_luminance(values)


def smoothed_reference(
    reference: ArrayLike, *, sigma: float = 8.0, epsilon: float = 0.01
) -> FloatArray:
    """
    The denominator of relative errors: smoothed reference luminance plus a small constant.

    A smooth denominator keeps the texture of the scene out of the spectrum of the error.

    Parameters
    ----------
    reference : array_like, (H, W) or (H, W, C)
        Reference image, not negative.
    sigma : float
        Standard deviation of the Gaussian in pixels.
    epsilon : float
        The constant, as a share of the mean reference luminance.

    Returns
    -------
    ndarray, (H, W)
        Positive everywhere.

    Raises
    ------
    ValueError
        If the reference is black.
    """
    y = luminance(reference)
    mean = float(y.mean())
    if not mean > 0.0:
        raise ValueError("The reference is black: relative errors are not defined.")
    smooth: FloatArray = ndimage.gaussian_filter(y, sigma, mode="nearest")
    return np.maximum(smooth, 0.0) + epsilon * mean
