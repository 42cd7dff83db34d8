"""A studio table of metals, glass and lacquer, from nearly polished to satin."""

from __future__ import annotations

from typing import Any

from . import vessels
from .furniture import Collection
from .geometry import fillet
from .materials import card, glass, glaze, light, metal, varnish
from .solids import box, moulding, pillow

DESCRIPTION = "rough metals of several roughnesses, frosted glass and lacquer under softboxes"
CAMERA = {"origin": (0.10, 0.66, 1.86), "target": (0.035, 0.10, 0.0), "fov": 38.0}

ALPHAS = (0.03, 0.09, 0.2, 0.4)


def build() -> dict[str, Any]:
    """Shapes and lights; ``ball_0`` ... ``ball_3`` are copper spheres of rising roughness."""
    materials = {
        "backdrop": varnish((0.23, 0.24, 0.26), 0.3),
        "frosted": glass(0.12),
        "clear": glass(),
        "lacquer": varnish((0.50, 0.035, 0.03), 0.06),
        "porcelain": glaze((0.78, 0.78, 0.76)),
        "silver": metal("Ag", 0.06),
        "gold": metal("Au", 0.16),
        "satin": metal("Al", 0.3),
        "teal": varnish((0.03, 0.22, 0.24), 0.2),
    }
    stage = Collection()
    # A sweep: floor, a wide curve, and the wall behind.
    sweep = fillet([(2.6, 0.0), (-1.1, 0.0, 0.7), (-1.1, 2.4)], 20)
    stage.add([("backdrop", moulding([(0, -3.2), (0, 3.2)], sweep, "zx", closed=False))])
    stage.add(vessels.teapot("silver", 0.23), (-0.245, 0, -0.02), 24)
    stage.add([("frosted", box((0.16, 0.16, 0.16), 0.018, 4).move(y=0.0802))], (0.30, 0, 0.20), 32)
    stage.add(
        [("lacquer", pillow((0.17, 0.15, 0.17), 2.6, 20).move(y=0.075))], (0.055, 0, 0.185), 10
    )
    stage.add(vessels.bowl("gold", 0.105), (-0.42, 0, 0.27))
    stage.add(
        [("clear", pillow((0.064, 0.064, 0.064), 2.0, 20).move(y=0.0322))], (-0.135, 0, 0.335)
    )
    stage.add(vessels.cup("porcelain"), (0.52, 0, 0.02), 130)
    stage.add(vessels.vase("teal", 0.30), (-0.56, 0, -0.10))
    stage.add([("satin", box((0.07, 0.20, 0.07), 0.008, 3).move(y=0.1))], (0.66, 0, -0.22), 25)
    radius = 0.088
    balls = {
        f"ball_{k}": {
            "type": "sphere",
            "center": [-0.02 + 0.195 * k, radius, -0.16 - 0.03 * k],
            "radius": radius,
            "bsdf": metal("Cu", alpha),
        }
        for k, alpha in enumerate(ALPHAS)
    }
    return {
        **stage.shapes(materials),
        **balls,
        "softbox": light((-1.5, 1.5, 0.9), (0.0, 0.05, 0.0), (1.1, 0.8), (15.0, 15.4, 16.2)),
        "strip": light((1.5, 0.9, -0.1), (0.1, 0.1, 0.0), (0.22, 1.1), (26.0, 19.0, 12.5)),
        "overhead": light((0.0, 2.2, -0.2), (0.0, 0.0, 0.05), (1.6, 0.5), (5.0, 5.0, 5.2)),
        # A reflector beside the camera fills the shadows with indirect light.
        "reflector": card((0.9, 0.9, 2.2), (0.0, 0.1, 0.0), (1.4, 1.0), (0.85, 0.85, 0.85)),
    }
