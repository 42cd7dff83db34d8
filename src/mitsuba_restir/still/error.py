"""The stated error of a still: what its own variance says of how far off it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..analysis.images import luminance
from ..analysis.metrics import DEFAULT_TRIM, relative_squared_error, trimmed_mean

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

    It is the root of the mean over pixels of s² / (m² + e²), with m the mean and s its standard
    error in each channel, e 1 % of the image's mean: `trimmed_relmse` with the variance of the mean
    in the place of the squared error and the mean in that of the reference.

    Parameters
    ----------
    mean, standard_error : arrays, (H, W, 3)

    Returns
    -------
    Stated
        Infinite where the picture is black.
    """
    finite = np.isfinite(mean).all(axis=2) & np.isfinite(standard_error).all(axis=2)
    bad = int(finite.size - np.count_nonzero(finite))
    if bad == finite.size:
        return Stated(math.inf, math.inf, bad)
    # As an image of one row: pixels are told apart, their places are not.
    picture = mean[finite][None].astype(np.float64)
    floor = FLOOR * float(luminance(picture).mean())
    if not floor > 0.0:
        return Stated(math.inf, math.inf, bad)
    errors = relative_squared_error(
        picture + standard_error[finite][None], picture, epsilon=floor**2
    )
    kept, every = (math.sqrt(trimmed_mean(errors, trim)) for trim in (DEFAULT_TRIM, 0.0))
    return Stated(kept, every, bad)
