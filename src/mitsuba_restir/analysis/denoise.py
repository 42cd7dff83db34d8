"""Denoising with Intel Open Image Denoise (optional), to measure what a denoiser makes of noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .images import FloatArray, finite


def denoise(image: ArrayLike) -> FloatArray:
    """
    Denoise an image with OIDN's filter for high dynamic range, without guides.

    Parameters
    ----------
    image : array_like, (H, W, 3)
        Linear colour, rendered with a box filter: a wider one correlates the noise of neighbouring
        pixels, and the denoiser keeps it.

    Returns
    -------
    ndarray, (H, W, 3)

    Raises
    ------
    ImportError
        If `mitsuba-oidn` is not installed.
    """
    try:
        import mitsuba_oidn
    except ImportError as error:
        raise ImportError("Denoising needs mitsuba-oidn: pip install mitsuba-oidn") from error
    colour = np.ascontiguousarray(finite(image, "The image", (3,)), dtype=np.float32)
    return np.array(mitsuba_oidn.denoise(colour, hdr=True), dtype=np.float64)
