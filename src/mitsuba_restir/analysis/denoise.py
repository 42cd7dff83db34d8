"""Denoising with Intel Open Image Denoise (optional), with and without guides."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..imageio import Image
from .images import FloatArray, finite

__all__ = ["denoise", "denoise_guided", "installed"]

GUIDES = ("albedo", "sh_normal")
"""Types of the auxiliary images that the denoiser is guided by."""


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
    ValueError
        A value of the image is not finite.
    """
    guides = {
        name: guide
        for name, guide in {"albedo": albedo, "normal": normal}.items()
        if guide is not None
    }
    return _filtered(finite(image, "The image", (3,)), guides).astype(np.float64)


def denoise_guided(colour: Image, albedo: Image, normal: Image) -> Image:
    """
    Denoise a picture that is shown: as `denoise`, but values that are not finite are passed on.

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
    return _filtered(colour, {"albedo": albedo, "normal": normal})


def installed() -> bool:
    """Whether the denoiser is there."""
    return importlib.util.find_spec("mitsuba_oidn") is not None


def require() -> None:
    """Raise ImportError, with what to install, where the denoiser is not installed."""
    _oidn()


def _filtered(colour: ArrayLike, guides: Mapping[str, ArrayLike]) -> Image:
    images = {name: np.ascontiguousarray(g, dtype=np.float32) for name, g in guides.items()}
    colour = np.ascontiguousarray(colour, dtype=np.float32)
    return np.array(_oidn().denoise(colour, hdr=True, **images), dtype=np.float32)


def _oidn() -> Any:
    try:
        import mitsuba_oidn
    except ImportError as error:
        raise ImportError("Denoising needs mitsuba-oidn: pip install mitsuba-oidn") from error
    return mitsuba_oidn
