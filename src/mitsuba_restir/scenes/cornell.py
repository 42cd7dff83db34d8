"""The classic box in a wide format: coloured walls, two blocks, one lamp."""

from __future__ import annotations

from typing import Any

from .materials import light, matte
from .mesh import mesh
from .solids import box, quad

DESCRIPTION = "a box with coloured walls, two blocks and one area light"
CAMERA = {"origin": (0.0, 0.95, 4.9), "target": (0.0, 0.95, 0.0), "fov": 43.6}

WIDTH, HEIGHT, DEPTH = 3.1, 1.9, 2.2


def build() -> dict[str, Any]:
    """Shapes and light; the box is open towards the camera."""
    x, y, z = 0.5 * WIDTH, HEIGHT, 0.5 * DEPTH
    white = matte((0.73, 0.71, 0.68))
    tall = box((0.58, 1.18, 0.58), 0.008).rotate("y", 20).move(-0.52, 0.59, -0.38)
    low = box((0.60, 0.60, 0.60), 0.008).rotate("y", -17).move(0.55, 0.30, 0.28)
    return {
        "floor": mesh("floor", quad((-x, 0, z), (2 * x, 0, 0), (0, 0, -2 * z)), white),
        "ceiling": mesh("ceiling", quad((-x, y, -z), (2 * x, 0, 0), (0, 0, 2 * z)), white),
        "back": mesh("back", quad((-x, 0, -z), (2 * x, 0, 0), (0, y, 0)), white),
        "left": mesh(
            "left", quad((-x, 0, z), (0, 0, -2 * z), (0, y, 0)), matte((0.61, 0.06, 0.05))
        ),
        "right": mesh(
            "right", quad((x, 0, -z), (0, 0, 2 * z), (0, y, 0)), matte((0.11, 0.42, 0.13))
        ),
        "tall_block": mesh("tall_block", tall, white),
        "low_block": mesh("low_block", low, white),
        "light": light((0.0, y - 0.004, 0.0), (0.0, 0.0, 0.0), (0.72, 0.52), (28.0, 23.0, 16.5)),
    }
