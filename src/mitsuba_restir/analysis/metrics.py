"""Errors of an image against a reference: RMSE, relMSE, SMAPE and HDR-FLIP."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from .images import FloatArray, finite, image_pair, luminance, variance_like

__all__ = [
    "displayed",
    "filtered_mse",
    "hdr_flip",
    "mean_ratio",
    "relmse",
    "rmse",
    "smape",
    "trimmed_relmse",
]

DEFAULT_EPSILON = 0.01
DEFAULT_TRIM = 0.001


def _positive(name: str, value: float) -> float:
    if not value > 0.0:
        raise ValueError(f"{name} must be positive, not {value}.")
    return value


def rmse(
    image: ArrayLike, reference: ArrayLike, *, reference_variance: ArrayLike | None = None
) -> float:
    """
    Root of the mean squared error over pixels and channels.

    Parameters
    ----------
    image, reference : array_like, (H, W) or (H, W, C)
        Two images of one shape.
    reference_variance : array_like, optional
        Variance of each value of the reference (of its mean, not of one sample). It is subtracted
        from the squared errors: E[(I - R')²] = E[(I - R)²] + Var(R') for independent I, R'.

    Returns
    -------
    float
        In units of the image. Zero where subtraction leaves a negative mean.
    """
    a, b = image_pair(image, reference)
    excess = float(np.mean((a - b) ** 2 - variance_like(reference_variance, b.shape)))
    return math.sqrt(max(excess, 0.0))


def displayed(image: ArrayLike) -> FloatArray:
    """
    Encode linear Rec. 709 as sRGB (IEC 61966-2-1), clipped to [0, 1] as a screen does.

    Parameters
    ----------
    image : array_like, (H, W) or (H, W, C)

    Returns
    -------
    ndarray, of the same shape
    """
    x = np.clip(finite(image, "The image", (2, 3)), 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1.0 / 2.4) - 0.055)


def displayed_variance(image: ArrayLike, variance: ArrayLike) -> FloatArray:
    """
    Variance of displayed values, by the delta method: the squared slope of `displayed` times it.

    Parameters
    ----------
    image, variance : array_like, of one shape
        Linear values, and the variance of each.

    Returns
    -------
    ndarray, of the same shape
        Zero where the screen clips.
    """
    x = finite(image, "The image", (2, 3))
    power = 1.055 / 2.4 * np.maximum(x, 0.0031308) ** (1.0 / 2.4 - 1.0)
    slope = np.where(x <= 0.0031308, 12.92, power) * ((x > 0.0) & (x < 1.0))
    return np.asarray(slope**2 * variance_like(variance, x.shape))


def relative_squared_error(
    image: ArrayLike,
    reference: ArrayLike,
    *,
    epsilon: float = DEFAULT_EPSILON,
    reference_variance: ArrayLike | None = None,
) -> FloatArray:
    """
    Per-value relative squared error ((I - R)² - Var R) / (R² + epsilon).

    See `relmse` for the parameters. With a variance, single values can be negative; only their mean
    is an estimate of the error.

    Returns
    -------
    ndarray
        Of the shape of the image.
    """
    a, b = image_pair(image, reference)
    excess = (a - b) ** 2 - variance_like(reference_variance, b.shape)
    return np.asarray(excess / (b**2 + _positive("epsilon", epsilon)))


def relmse(
    image: ArrayLike,
    reference: ArrayLike,
    *,
    epsilon: float = DEFAULT_EPSILON,
    reference_variance: ArrayLike | None = None,
) -> float:
    """
    Relative mean squared error: mean of (I - R)² / (R² + epsilon) over pixels and channels.

    Parameters
    ----------
    image, reference : array_like, (H, W) or (H, W, C)
        Two images of one shape.
    epsilon : float
        Keeps dark values from dominating; in squared units of the image. State it with the result.
    reference_variance : array_like, optional
        Variance of each value of the reference, subtracted from the squared error as in `rmse`.

    Returns
    -------
    float
        Negative only if the reference's variance exceeds the error that was to be measured.
    """
    errors = relative_squared_error(
        image, reference, epsilon=epsilon, reference_variance=reference_variance
    )
    return float(errors.mean())


def trimmed_relmse(
    image: ArrayLike,
    reference: ArrayLike,
    *,
    epsilon: float = DEFAULT_EPSILON,
    trim: float = DEFAULT_TRIM,
    reference_variance: ArrayLike | None = None,
) -> float:
    """
    relMSE without the worst pixels: the mean over all but the largest share `trim` of them.

    A handful of fireflies decides the plain relMSE of a path-traced image; the trimmed value says
    what the rest looks like. Pixels are ranked by the mean over their channels.

    Parameters
    ----------
    image, reference, epsilon, reference_variance
        As in `relmse`.
    trim : float
        Share of pixels left out, 0 <= trim < 1; their number is rounded down.
    """
    errors = relative_squared_error(
        image, reference, epsilon=epsilon, reference_variance=reference_variance
    )
    return trimmed_mean(errors, trim)


def trimmed_mean(errors: FloatArray, trim: float = DEFAULT_TRIM) -> float:
    """
    Mean of per-value errors (H, W) or (H, W, C) without the largest share of the pixels.

    Pixels are ranked by the mean over their channels; see `trimmed_relmse`.
    """
    if not 0.0 <= trim < 1.0:
        raise ValueError(f"trim must be in [0, 1), not {trim}.")
    pixels = np.sort(errors.reshape(errors.shape[0] * errors.shape[1], -1).mean(axis=1))
    kept = pixels.size - int(trim * pixels.size)
    return float(pixels[:kept].mean())


def smape(image: ArrayLike, reference: ArrayLike, *, epsilon: float = DEFAULT_EPSILON) -> float:
    """
    Symmetric mean absolute error: mean of ``|I - R| / (|I| + |R| + epsilon)``, between 0 and 1.

    The form of Vogels et al. 2018 ("Denoising with Kernel Prediction and Asymmetric Loss
    Functions"), who use epsilon = 0.01.
    """
    a, b = image_pair(image, reference)
    return float(np.mean(np.abs(a - b) / (np.abs(a) + np.abs(b) + _positive("epsilon", epsilon))))


def mean_ratio(image: ArrayLike, reference: ArrayLike) -> float:
    """
    Mean luminance of the image over that of the reference: 1 where no energy is lost or gained.

    Raises
    ------
    ValueError
        If the reference is black.
    """
    a, b = image_pair(image, reference)
    mean = float(luminance(b).mean())
    if not mean > 0.0:
        raise ValueError("The reference is black: the ratio of means is not defined.")
    return float(luminance(a).mean()) / mean


def hdr_flip(image: ArrayLike, reference: ArrayLike, *, pixels_per_degree: float = 67.0) -> float:
    """
    Mean HDR-FLIP (Andersson et al. 2021) by NVIDIA's `flip-evaluator`.

    The exposures come from the reference alone, so that variants compared with one reference are
    seen at the same exposures. Negative values are set to zero, as FLIP requires.

    Parameters
    ----------
    image, reference : array_like, (H, W) or (H, W, C)
        Linear Rec. 709 of one shape.
    pixels_per_degree : float
        Resolution at which the image is looked at; 67 is FLIP's default.

    Returns
    -------
    float
        Mean of the map; 0 is equal, 1 the largest difference.

    Raises
    ------
    ImportError
        If `flip-evaluator` is not installed.
    """
    try:
        import flip_evaluator
    except ImportError as error:
        raise ImportError("HDR-FLIP needs flip-evaluator: pip install flip-evaluator") from error
    a, b = (_rgb32(x) for x in image_pair(image, reference))
    error_map, _, _ = flip_evaluator.evaluate(
        b, a, "HDR", applyMagma=False, parameters={"ppd": float(pixels_per_degree)}
    )
    return float(np.asarray(error_map, dtype=np.float64).reshape(a.shape[:2]).mean())


def _rgb32(image: FloatArray) -> np.ndarray:
    colour = image[..., None] if image.ndim == 2 else image
    if colour.shape[2] not in (1, 3):
        raise ValueError(f"FLIP needs 1 or 3 channels, not {colour.shape[2]}.")
    rgb = np.broadcast_to(colour, (*colour.shape[:2], 3))
    return np.ascontiguousarray(np.maximum(rgb, 0.0), dtype=np.float32)


def filtered_mse(error: ArrayLike, sigma: float) -> float:
    """
    Mean square of the error as seen from a distance, through a Gaussian: mean((g_sigma * e)²).

    Parameters
    ----------
    error : array_like, (H, W) or (F, H, W)
        Error images, mirrored at their border; the mean is over all frames.
    sigma : float
        Standard deviation in pixels; 1.5 is about what the eye does to pixels of a screen.
    """
    e = finite(error, "The error", (2, 3))
    seen = ndimage.gaussian_filter(e, (0.0, sigma, sigma)[3 - e.ndim :], mode="reflect")
    return float(np.mean(seen**2))
