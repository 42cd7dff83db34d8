"""Denoising finished frames with Intel Open Image Denoise, an optional dependency."""

from __future__ import annotations

import importlib.util

import numpy as np

from ..errors import UsageError
from ..imageio import Image

GUIDES = ("albedo", "sh_normal")
"""AOV types that the denoiser is guided by."""


def require() -> None:
    """
    Make sure that the denoiser is installed.

    Raises
    ------
    UsageError
        It is not; says how to install it.
    """
    if importlib.util.find_spec("mitsuba_oidn") is None:
        raise UsageError("argument --denoise: needs pip install 'mitsuba-restir[denoise]'")


def denoise(colour: Image, albedo: Image, normal: Image) -> Image:
    """
    Denoise one image.

    Parameters
    ----------
    colour, albedo, normal : arrays, (H, W, 3)
        Linear colour, diffuse albedo in [0, 1], shading normal in world space. Colour must come
        from a box filter: a wider one correlates the noise of pixels, and the denoiser keeps it.

    Returns
    -------
    array, (H, W, 3)
    """
    import mitsuba_oidn

    arrays = [np.ascontiguousarray(a, dtype=np.float32) for a in (colour, albedo, normal)]
    result = mitsuba_oidn.denoise(arrays[0], albedo=arrays[1], normal=arrays[2], hdr=True)
    return np.array(result, dtype=np.float32)
