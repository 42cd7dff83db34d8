"""Denoising with Intel Open Image Denoise (optional), with and without guides."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..imageio import Image
from .images import FloatArray, finite

GUIDES = ("albedo", "sh_normal")
"""Types of the auxiliary images that the denoiser is guided by."""


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
    oidn = _oidn()
    colour = np.ascontiguousarray(finite(image, "The image", (3,)), dtype=np.float32)
    return np.array(oidn.denoise(colour, hdr=True), dtype=np.float64)


def denoise_guided(colour: Image, albedo: Image, normal: Image) -> Image:
    """
    Denoise one image with OIDN, guided by what the camera sees.

    Parameters
    ----------
    colour, albedo, normal : arrays, (H, W, 3)
        Linear colour, diffuse albedo in [0, 1], shading normal in world space. Colour must come
        from a box filter: a wider one correlates the noise of pixels, and the denoiser keeps it.

    Returns
    -------
    array, (H, W, 3)

    Raises
    ------
    ImportError
        If `mitsuba-oidn` is not installed.
    """
    oidn = _oidn()
    arrays = [np.ascontiguousarray(a, dtype=np.float32) for a in (colour, albedo, normal)]
    result = oidn.denoise(arrays[0], albedo=arrays[1], normal=arrays[2], hdr=True)
    return np.array(result, dtype=np.float32)


def require() -> None:
    """Raise ImportError, with what to install, where the denoiser is not installed."""
    _oidn()


def _oidn() -> Any:
    try:
        import mitsuba_oidn
    except ImportError as error:
        raise ImportError("Denoising needs mitsuba-oidn: pip install mitsuba-oidn") from error
    return mitsuba_oidn
