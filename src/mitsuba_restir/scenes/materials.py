"""Short names for the BSDF, texture and emitter dicts the scenes share."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

from .geometry import Array

RGB = tuple[float, float, float]
Colour = RGB | dict[str, Any]


def rgb(colour: Colour) -> dict[str, Any]:
    """An RGB triple as a spectrum dict; a texture dict passes through."""
    return colour if isinstance(colour, dict) else {"type": "rgb", "value": list(colour)}


def picture(image: Array, repeat: tuple[float, float] = (1.0, 1.0)) -> dict[str, Any]:
    """
    Texture from sRGB-encoded values in [0, 1], (height, width, 3), its first row at v = 1.

    ``repeat`` says how often it repeats per unit of (u, v).
    """
    # Mitsuba puts the first row of a bitmap at v = 0.
    pixels = np.round(np.clip(image[::-1], 0, 1) * 255).astype(np.uint8)
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(pixels)),
        "to_uv": mi.ScalarTransform4f().scale([repeat[0], repeat[1], 1.0]),
    }


def matte(colour: Colour) -> dict[str, Any]:
    """Diffuse reflection."""
    return {"type": "diffuse", "reflectance": rgb(colour)}


def varnish(colour: Colour, alpha: float = 0.1) -> dict[str, Any]:
    """Diffuse base under a rough dielectric coat: lacquer, glazed clay, polished wood."""
    return {
        "type": "roughplastic",
        "distribution": "ggx",
        "diffuse_reflectance": rgb(colour),
        "alpha": alpha,
        "nonlinear": True,
    }


def glaze(colour: Colour) -> dict[str, Any]:
    """Diffuse base under a perfectly smooth coat: porcelain."""
    return {"type": "plastic", "diffuse_reflectance": rgb(colour), "nonlinear": True}


def metal(name: str, alpha: float) -> dict[str, Any]:
    """Rough conductor from Mitsuba's table of materials (``'Au'``, ``'Cu'``, ``'Al'`` ...)."""
    return {"type": "roughconductor", "distribution": "ggx", "material": name, "alpha": alpha}


def glass(alpha: float = 0.0, ior: float = 1.5) -> dict[str, Any]:
    """Clear (``alpha`` zero) or frosted glass."""
    if alpha == 0.0:
        return {"type": "dielectric", "int_ior": ior}
    return {"type": "roughdielectric", "distribution": "ggx", "alpha": alpha, "int_ior": ior}


def card(
    origin: RGB, target: RGB, size: tuple[float, float], colour: RGB = (0.0, 0.0, 0.0)
) -> dict[str, Any]:
    """Rectangle of ``size`` [m] centred at ``origin`` [m], its matte front facing ``target``."""
    up = [0.0, 0.0, 1.0] if origin[0] == target[0] and origin[2] == target[2] else [0.0, 1.0, 0.0]
    place = mi.ScalarTransform4f().look_at(origin=list(origin), target=list(target), up=up)
    return {
        "type": "rectangle",
        "to_world": place @ mi.ScalarTransform4f().scale([0.5 * size[0], 0.5 * size[1], 1.0]),
        "bsdf": matte(colour),
    }


def light(origin: RGB, target: RGB, size: tuple[float, float], radiance: RGB) -> dict[str, Any]:
    """A black `card` that emits from its front."""
    return {
        **card(origin, target, size),
        "emitter": {"type": "area", "radiance": rgb(radiance)},
    }
