"""Furniture for the scenes, each standing on y = 0 at the origin.

A piece is a list of (material, geometry) pairs; the materials are names that the scene gives
a meaning to. `Collection` gathers pieces and makes one mesh per material.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from .geometry import Geometry, fillet, merge, spline
from .mesh import mesh
from .solids import box, lathe, moulding, tube

Piece = list[tuple[str, Geometry]]


class Collection:
    """Parts sorted by material."""

    def __init__(self) -> None:
        self._parts: defaultdict[str, list[Geometry]] = defaultdict(list)

    def add(
        self,
        piece: Iterable[tuple[str, Geometry]],
        at: tuple[float, float, float] = (0.0, 0.0, 0.0),
        turn: float = 0.0,
    ) -> None:
        """Place a piece, turned about the y axis [degrees] and then moved [m]."""
        for material, geometry in piece:
            self._parts[material].append(geometry.rotate("y", turn).move(*at))

    def shapes(self, materials: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
        """One mesh per material, named ``prefix + material``."""
        return {
            prefix + name: mesh(prefix + name, merge(parts), materials[name])
            for name, parts in self._parts.items()
        }


def sideboard(width: float, height: float, depth: float, doors: int = 3) -> Piece:
    """Cabinet on tapered legs, its back at z = 0; materials wood, metal."""
    leg, slab, gap = 0.16, 0.03, 0.004
    body = height - leg - slab
    parts: Piece = []
    top = box((width, slab, depth), 0.006).move(0, height - 0.5 * slab, 0.5 * depth)
    core = box((width - 0.03, body, depth - 0.035), 0.003).move(
        0, leg + 0.5 * body, 0.5 * depth - 0.0175
    )
    parts += [("wood", top), ("wood", core.move_uv(0.3, 0.21))]
    front = (width - 0.03 - gap) / doors
    for k in range(doors):
        x = -0.5 * (width - 0.03) + gap + k * front + 0.5 * (front - gap)
        door = box((front - gap, body - 2 * gap, 0.018), 0.003).move(
            x, leg + 0.5 * body, depth - 0.026
        )
        parts.append(("wood", door.move_uv(0.37 * k, 0.13 * k)))
        knob = lathe(
            fillet(
                [
                    (0, 0),
                    (0.006, 0),
                    (0.006, 0.012, 0.004),
                    (0.014, 0.016, 0.003),
                    (0.014, 0.024, 0.006),
                    (0, 0.026),
                ],
                4,
            ),
            24,
        )
        side = -1.0 if k == doors - 1 else 1.0
        parts.append(
            (
                "metal",
                knob.rotate("x", 90).move(
                    x + side * (0.5 * front - 0.04), leg + 0.62 * body, depth - 0.017
                ),
            )
        )
    for sx in (-1, 1):
        for z in (0.06, depth - 0.08):
            foot = lathe(fillet([(0, 0), (0.011, 0, 0.003), (0.02, leg), (0, leg)]), 20)
            parts.append(("wood", foot.move(sx * (0.5 * width - 0.10), 0, z)))
    return parts


def framed_picture(width: float, height: float) -> Piece:
    """Picture with a passe-partout in a moulded frame, its back at z = 0, centred on the origin;
    materials frame, mount, canvas (its texture coordinates span the canvas once)."""
    a, b, margin = 0.5 * width, 0.5 * height, 0.06
    opening = [
        (-a - margin, -b - margin),
        (a + margin, -b - margin),
        (a + margin, b + margin),
        (-a - margin, b + margin),
    ]
    profile = fillet(
        [
            (0.034, 0.0),
            (0.034, 0.026, 0.006),
            (0.018, 0.030, 0.01),
            (0.004, 0.016, 0.004),
            (0.0, 0.016, 0.002),
            (0.0, 0.008),
        ],
        4,
    )
    mount = box((width + 2 * margin, height + 2 * margin, 0.008)).move(z=0.004)
    bevel = moulding(
        [(-a, -b), (a, -b), (a, b), (-a, b)],
        [(0.003, 0.008), (0.003, 0.0095), (0.0, 0.0085), (0.0, 0.008)],
        crease=20,
    )
    canvas = box((width, height, 0.0004)).move(z=0.0082).move_uv(a, b)
    return [
        ("frame", moulding(opening, profile)),
        ("mount", mount),
        ("mount", bevel),
        ("canvas", canvas.scale_uv(1 / width, 1 / height)),
    ]


def table_lamp() -> Piece:
    """Lamp (off): clay base, metal neck, fabric shade; 0.5 m high."""
    base = lathe(
        np.concatenate(
            [
                [[0, 0]],
                spline(
                    [
                        (0.055, 0),
                        (0.062, 0.012),
                        (0.098, 0.08),
                        (0.085, 0.16),
                        (0.034, 0.225),
                        (0.02, 0.245),
                    ],
                    6,
                ),
                [[0, 0.245]],
            ]
        ),
        48,
    )
    neck = lathe(
        fillet(
            [
                (0, 0.245),
                (0.014, 0.245, 0.002),
                (0.014, 0.262, 0.003),
                (0.006, 0.266),
                (0.006, 0.33),
                (0, 0.33),
            ]
        ),
        20,
    )
    shade = lathe([(0.160, 0.27), (0.162, 0.27), (0.112, 0.50), (0.110, 0.50), (0.160, 0.27)], 56)
    spokes = [
        tube([(0, 0.328, 0), (0.147 * np.cos(t), 0.325, 0.147 * np.sin(t))], 0.002, 6)
        for t in np.deg2rad([90, 210, 330])
    ]
    return [("clay", base), ("metal", neck), ("fabric", shade), *(("metal", s) for s in spokes)]


def books(spec: Iterable[tuple[str, float, float, float, float]]) -> Piece:
    """
    Stack of books: rows (cover material, width, thickness, depth [m], turn [degrees]), bottom
    first; material paper for the pages.
    """
    parts: Piece = []
    y = 0.0
    for cover, width, thick, depth, turn in spec:
        board = 0.0025
        pages = box((width - 0.008, thick - 2 * board, depth - 0.010), 0.001, 1).move(
            -0.003, y + 0.5 * thick, 0
        )
        sheets = [
            box((width, board, depth), 0.0011, 1).move(0, y + h, 0)
            for h in (0.5 * board, thick - 0.5 * board)
        ]
        # The spine faces +z, its rounding outwards.
        spine = box((width, thick, 0.006), 0.0028, 2).move(0, y + 0.5 * thick, 0.5 * depth)
        parts += [
            (material, part.rotate("y", turn))
            for material, part in [
                ("paper", pages),
                (cover, sheets[0]),
                (cover, sheets[1]),
                (cover, spine),
            ]
        ]
        y += thick
    return parts


def stool(radius: float = 0.27, height: float = 0.36) -> Piece:
    """Upholstered round stool; materials cushion, wood."""
    plate = 0.14
    profile = fillet(
        [
            (0, plate),
            (radius - 0.02, plate, 0.012),
            (radius, 0.5 * (plate + height)),
            (radius - 0.008, height, 0.05),
            (0, height + 0.012),
        ],
        8,
    )
    seat = lathe(profile, 64, crease=60)
    rim = lathe(
        fillet(
            [
                (0, plate - 0.022),
                (radius - 0.03, plate - 0.022, 0.006),
                (radius - 0.03, plate),
                (0, plate),
            ]
        ),
        48,
    )
    parts: Piece = [("cushion", seat), ("wood", rim)]
    for k in range(4):
        angle = np.deg2rad(45 + 90 * k)
        foot = lathe(
            fillet([(0, 0), (0.010, 0, 0.003), (0.017, plate - 0.022), (0, plate - 0.022)]), 16
        )
        parts.append(
            ("wood", foot.move((radius - 0.07) * np.cos(angle), 0, (radius - 0.07) * np.sin(angle)))
        )
    return parts
