"""Scenes built in code: nothing to download, the same on every machine.

Each scene is a module with ``DESCRIPTION``, ``CAMERA`` and ``build()``. Mitsuba objects are made
when a scene is asked for, in the variant that is active then.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import mitsuba as mi

from . import ajar, cornell, court, gloss

__all__ = ["as_dict", "describe", "load", "names"]

_SCENES: dict[str, ModuleType] = {
    "ajar": ajar,
    "cornell": cornell,
    "gloss": gloss,
    "court": court,
}


def _find(name: str) -> ModuleType:
    if name not in _SCENES:
        raise ValueError(f"unknown scene '{name}': choose one of {', '.join(_SCENES)}")
    return _SCENES[name]


def names() -> list[str]:
    """Names of the embedded scenes."""
    return list(_SCENES)


def describe(name: str) -> str:
    """One line about a scene. Raises ``ValueError`` for an unknown name."""
    return str(_find(name).DESCRIPTION)


def as_dict(name: str, width: int = 640, height: int = 360) -> dict[str, Any]:
    """
    A scene as a dict for ``mi.load_dict``, in the current variant.

    Parameters
    ----------
    name : str
        One of `names`.
    width, height : int
        Resolution of the film [pixels].

    Returns
    -------
    dict
        Shapes and emitters under names of their own, the camera as ``sensor`` (box filter, float32
        RGB film) and Mitsuba's ``path`` as ``integrator``. Meshes are ``mi.Mesh`` objects; entries
        may be replaced or removed before loading.

    Raises
    ------
    ValueError
        For an unknown name or a size below one pixel.
    """
    scene = _find(name)
    if width < 1 or height < 1:
        raise ValueError(f"film size {width}x{height}: both sides must be at least 1 pixel")
    camera = scene.CAMERA
    view = mi.ScalarTransform4f().look_at(
        origin=list(camera["origin"]), target=list(camera["target"]), up=[0, 1, 0]
    )
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 10},
        "sensor": {
            "type": "perspective",
            "fov": camera["fov"],
            "fov_axis": "x",
            "near_clip": 0.01,
            "far_clip": 1000.0,
            "to_world": view,
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        },
        **scene.build(),
    }


def load(name: str, width: int = 640, height: int = 360) -> Any:
    """A scene as ``mi.Scene``; arguments and errors as in `as_dict`."""
    # Merged shapes would come in an order of addresses, and with the order of the lights changes
    # what a seed renders.
    return mi.load_dict(as_dict(name, width, height), optimize=False)
