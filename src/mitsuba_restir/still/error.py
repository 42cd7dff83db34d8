"""The stated error of a still: what its own variance says of how far off it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..analysis.images import FloatArray, luminance
from ..analysis.metrics import DEFAULT_TRIM, relative_squared_error, trimmed_mean

NEAR = 2.0
"""Standard deviation of the Gaussian through which a pixel's brightness is judged [pixels]."""

FLOOR = 0.01
"""What keeps dark pixels from deciding alone, as a share of the image's mean luminance."""


@dataclass(frozen=True)
class Stated:
    """
    A stated error.

    Attributes
    ----------
    error : float
        Without the worst 0.1 % of the pixels.
    untrimmed : float
        With all of them.
    not_finite : int
        How many pixels are not finite, and in neither.
    """

    error: float
    untrimmed: float
    not_finite: int = 0


UNKNOWN = Stated(math.inf, math.inf)
"""The error of a picture of which too little is known."""


def stated(mean: npt.NDArray[np.float32], standard_error: npt.NDArray[np.float32]) -> Stated:
    """
    The relative error of a mean of frames.

    It is the root of the mean over pixels of s² / (m² + e²), with s the standard error in each
    channel, m the mean through a Gaussian of :data:`NEAR` pixels, e 1 % of the image's mean:
    `trimmed_relmse` with the variance of the mean in the place of the squared error, and m in that
    of the reference. With a pixel's own mean as m the error would be understated wherever tails are
    heavy: s is large where the mean is too large. In ``gloss`` at 64x36 with 4, 12, 48 frames the
    stated error is 0.48, 0.54, 0.66 of the true one with the pixel's own mean, and 0.95, 1.00, 0.98
    with this one (means of 20 stills).

    Parameters
    ----------
    mean, standard_error : arrays, (H, W, 3)

    Returns
    -------
    Stated
        Infinite where the picture is black.
    """
    finite = np.isfinite(np.concatenate([mean, standard_error], axis=2)).all(axis=2)
    bad = int(finite.size - np.count_nonzero(finite))
    if bad == finite.size:
        return Stated(math.inf, math.inf, bad)
    # As images of one row: pixels are told apart, their places are not.
    smooth = _smoothed(mean, finite)[finite][None]
    floor = FLOOR * float(luminance(mean[finite][None]).mean())
    if not floor > 0.0:
        return Stated(math.inf, math.inf, bad)
    errors = relative_squared_error(smooth + standard_error[finite][None], smooth, epsilon=floor**2)
    kept, every = (math.sqrt(trimmed_mean(errors, trim)) for trim in (DEFAULT_TRIM, 0.0))
    return Stated(kept, every, bad)


def _smoothed(mean: npt.NDArray[np.float32], finite: npt.NDArray[np.bool_]) -> FloatArray:
    """The mean through a Gaussian that sees the finite pixels alone."""
    whole = np.where(finite[..., None], mean, 0.0).astype(np.float64)
    share = finite.astype(np.float64)[..., None]
    seen, weight = (
        ndimage.gaussian_filter(image, (NEAR, NEAR, 0.0), mode="nearest")
        for image in (whole, share)
    )
    return np.asarray(seen / np.where(weight > 0.0, weight, 1.0))
