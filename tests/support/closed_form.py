"""Scenes whose image is known in closed form, for any depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

SIZE = 32


@dataclass(frozen=True)
class ClosedForm:
    """A scene, its depth, and the radiance that every pixel must have (RGB)."""

    scene: dict[str, Any]
    max_depth: int
    radiance: tuple[float, float, float]

    def reference(self) -> np.ndarray:
        return np.broadcast_to(np.asarray(self.radiance), (SIZE, SIZE, 3)).copy()


def camera(origin: list[float], target: list[float], fov: float = 60.0) -> dict[str, Any]:
    return {
        "type": "perspective",
        "fov": fov,
        "to_world": mi.ScalarTransform4f().look_at(origin, target, [0, 1, 0]),
        "film": {
            "type": "hdrfilm",
            "width": SIZE,
            "height": SIZE,
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent", "sample_count": 1},
    }


def _rgb(value: tuple[float, float, float]) -> dict[str, Any]:
    return {"type": "rgb", "value": list(value)}


def _geometric(first: float, ratio: float, terms: int) -> float:
    """first (1 + ratio + ... ), ``terms`` terms (-1: all)."""
    return (
        first * terms
        if ratio == 1
        else first * (1 - ratio ** (terms if terms >= 0 else 1e9)) / (1 - ratio)
    )


def glowing_box(max_depth: int, coloured: bool = False) -> ClosedForm:
    """Inside of a box that emits and reflects: Le (1 + rho + rho^2 + ...).

    A box and not a sphere: on Mitsuba's sphere light, seen from its own inner surface, ``path`` is
    too bright by 0.2 %.
    """
    emitted = (0.9, 0.5, 0.2) if coloured else (0.5, 0.5, 0.5)
    albedo = (0.2, 0.5, 0.7) if coloured else (0.5, 0.5, 0.5)
    scene = {
        "type": "scene",
        "sensor": camera([0.1, 0.2, 0.8], [-0.6, -0.3, 0]),
        "box": {
            "type": "cube",
            "flip_normals": True,
            "bsdf": {"type": "diffuse", "reflectance": _rgb(albedo)},
            "emitter": {"type": "area", "radiance": _rgb(emitted)},
        },
    }
    radiance = tuple(_geometric(e, a, max_depth) for e, a in zip(emitted, albedo, strict=True))
    return ClosedForm(scene, max_depth, radiance)


def lit_sphere(max_depth: int, coloured: bool = False) -> ClosedForm:
    """Inside of a sphere with a point light of intensity pi in its centre: rho + rho^2 + ..."""
    albedo = (0.3, 0.5, 0.7) if coloured else (0.5, 0.5, 0.5)
    scene = {
        "type": "scene",
        "sensor": camera([0.1, 0.2, 0.8], [0, 0, 0]),
        "sphere": {
            "type": "sphere",
            "flip_normals": True,
            "bsdf": {"type": "diffuse", "reflectance": _rgb(albedo)},
        },
        "light": {"type": "point", "position": [0, 0, 0], "intensity": float(np.pi)},
    }
    terms = max_depth - 1 if max_depth > 0 else -1
    return ClosedForm(scene, max_depth, tuple(_geometric(a, a, terms) for a in albedo))


def furnace() -> ClosedForm:
    """Lossless objects in a constant environment: nothing can be seen of them, at any depth.

    Concave (a bowl), specular, masked and two-sided objects take part, so that paths are long.
    """
    white = {"type": "diffuse", "reflectance": 1.0}
    transform = mi.ScalarTransform4f
    materials: list[dict[str, Any]] = [
        white,
        {"type": "conductor", "material": "none"},
        {"type": "dielectric"},
        {"type": "thindielectric"},
        {"type": "mask", "opacity": 0.5, "nested": {"type": "twosided", "nested": white}},
        {
            "type": "blendbsdf",
            "weight": 0.4,
            "first": white,
            "second": {"type": "conductor", "material": "none"},
        },
    ]
    scene: dict[str, Any] = {
        "type": "scene",
        "sensor": camera([0, 3.5, 4.5], [0, 0, 0], 45.0),
        "sky": {"type": "constant", "radiance": 1.0},
        "floor": {
            "type": "rectangle",
            "to_world": transform().rotate([1, 0, 0], -90).scale([2.5, 2.5, 1]),
            "bsdf": {"type": "twosided", "nested": white},
        },
        "wall": {
            "type": "rectangle",
            "to_world": transform().translate([0, 1, -1.6]).scale([2.5, 1, 1]),
            "bsdf": {"type": "twosided", "nested": white},
        },
    }
    for i, material in enumerate(materials):
        scene[f"ball_{i}"] = {
            "type": "sphere",
            "center": [(i % 3 - 1) * 1.2, 0.5, (i // 3 - 0.5) * 1.4],
            "radius": 0.45,
            "bsdf": material,
        }
    return ClosedForm(scene, -1, (1.0, 1.0, 1.0))
