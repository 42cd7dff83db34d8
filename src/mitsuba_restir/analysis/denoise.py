"""Denoising with Intel Open Image Denoise (optional), to measure what a denoiser makes of noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .images import FloatArray, finite


def denoise(
    image: ArrayLike, albedo: ArrayLike | None = None, normal: ArrayLike | None = None
) -> FloatArray:
    """
    Denoise an image with OIDN's filter for high dynamic range.

    Parameters
    ----------
    image : array_like, (H, W, 3)
        Linear colour, rendered with a box filter: a wider one correlates the noise of neighbouring
        pixels, and the denoiser keeps it.
    albedo, normal : array_like, (H, W, 3), optional
        What guides the filter: diffuse albedo in [0, 1] and shading normal in world space. A normal
        without an albedo is of no use to it.

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
    guides = {
        name: np.ascontiguousarray(guide, dtype=np.float32)
        for name, guide in {"albedo": albedo, "normal": normal}.items()
        if guide is not None
    }
    return np.array(mitsuba_oidn.denoise(colour, hdr=True, **guides), dtype=np.float64)
