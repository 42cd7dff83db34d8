"""Furniture and small objects for the scenes, each standing on y = 0 at the origin.

A piece is a list of (material, geometry) pairs; the materials are names that the scene gives
a meaning to. `Collection` gathers pieces and makes one mesh per material.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from .geometry import Array, Geometry, fillet, merge, spline
from .mesh import mesh
from .noise import hash01
from .solids import box, lathe, moulding, pillow, tube

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


def vessel(outline: Iterable[tuple[float, float]], wall: float, steps: int = 4) -> Array:
    """
    Profile of an open vessel with a rounded rim.

    Parameters
    ----------
    outline : (radius, height) control points of the outside, foot to rim [m]; the foot is flat
    wall : thickness [m]
    """
    outside = spline(list(outline), steps)
    tangent = np.gradient(outside, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    inward = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    inside = (outside + wall * inward)[::-1]
    inside = inside[(inside[:, 1] > wall) & (inside[:, 0] > 0.1 * outside[0, 0])]
    rim = outside[-1] + 0.5 * wall * inward[-1]
    angle = np.linspace(0.0, np.pi, 7)[1:-1, None]
    edge = rim + 0.5 * wall * (-np.cos(angle) * inward[-1] + np.sin(angle) * tangent[-1])
    return np.concatenate([[[0.0, 0.0]], outside, edge, inside, [[0.0, wall]]])


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


def bowl(material: str, radius: float = 0.13, wall: float = 0.004) -> Piece:
    """Footed bowl."""
    outline = [(0.40, 0.0), (0.38, 0.06), (0.46, 0.14), (0.74, 0.26), (0.94, 0.46), (1.0, 0.68)]
    return [(material, lathe(vessel([(radius * r, radius * h) for r, h in outline], wall), 64))]


def vase(material: str, height: float = 0.32) -> Piece:
    """Slender vase with a flared lip."""
    outline = [
        (0.15, 0.0),
        (0.19, 0.06),
        (0.27, 0.32),
        (0.24, 0.55),
        (0.115, 0.78),
        (0.105, 0.88),
        (0.15, 1.0),
    ]
    profile = vessel([(height * r, height * h) for r, h in outline], 0.005)
    return [(material, lathe(profile, 52))]


def branches(height: float, reach: float, count: int = 5, seed: int = 5) -> Piece:
    """Bare twigs rising from a point, with buds; materials twig, bud."""
    parts: Piece = []
    for k in range(count):
        u = [float(hash01(k, j, seed)) for j in range(8)]
        heading = 2 * np.pi * (k + 0.6 * u[0]) / count
        out = reach * (0.45 + 0.55 * u[1]) * np.array([np.cos(heading), np.sin(heading)])
        up = height * (0.68 + 0.32 * u[2])
        sway = 0.16 * reach * np.array([u[3] - 0.5, u[4] - 0.5])
        curve = spline(
            [
                (0.004 * np.cos(heading), 0, 0.004 * np.sin(heading)),
                (0.18 * out[0], 0.35 * up, 0.18 * out[1]),
                (0.5 * out[0] + sway[0], 0.68 * up, 0.5 * out[1] + sway[1]),
                (out[0], up, out[1]),
            ],
            6,
        )
        parts.append(("twig", tube(curve, np.linspace(0.0035, 0.0012, len(curve)), 7, 2)))
        for j, node in enumerate(range(8, len(curve), 2)):
            turn = heading + (2.1 if j % 2 else -2.1)
            start = curve[node]
            tip = start + (0.05 + 0.05 * u[j % 8]) * np.array(
                [np.cos(turn) * 0.7, 0.75, np.sin(turn) * 0.7]
            )
            parts.append(
                (
                    "twig",
                    tube(spline([start, 0.5 * (start + tip) + [0, -0.006, 0], tip]), 0.0012, 6, 2),
                )
            )
            parts.append(("bud", pillow((0.011, 0.016, 0.011), 2.0, 2).move(*tip)))
    return parts


def decanter(size: float = 1.15) -> Piece:
    """Glass bottle closed with a ball, 0.27 m high at ``size`` 1; material glass."""
    outline = [
        (0.040, 0.0),
        (0.052, 0.010),
        (0.056, 0.05),
        (0.055, 0.11),
        (0.040, 0.150),
        (0.019, 0.175),
        (0.016, 0.20),
        (0.021, 0.225),
    ]
    body = vessel([(size * r, size * h) for r, h in outline], 0.0045 * size)
    diameter = 0.042 * size
    ball = pillow((diameter, diameter, diameter), 2.0, 8).move(y=0.2365 * size + 0.22 * diameter)
    return [("glass", lathe(body, 40)), ("glass", ball)]


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


def cup(material: str) -> Piece:
    """Cup with a handle on a saucer."""
    saucer = lathe(
        vessel([(0.035, 0.0), (0.038, 0.003), (0.062, 0.008), (0.076, 0.016)], 0.003), 40
    )
    body = lathe(vessel([(0.022, 0.0), (0.025, 0.004), (0.036, 0.025), (0.041, 0.060)], 0.0025), 40)
    handle = tube(
        spline([(0.0365, 0.048, 0), (0.055, 0.050, 0), (0.058, 0.034, 0), (0.034, 0.018, 0)], 8),
        0.0035,
        10,
    )
    return [(material, saucer), (material, body.move(y=0.0031)), (material, handle.move(y=0.0031))]


def amphora(material: str, height: float = 0.62) -> Piece:
    """Tall floor jar."""
    outline = [
        (0.17, 0.0),
        (0.19, 0.03),
        (0.33, 0.35),
        (0.345, 0.58),
        (0.24, 0.80),
        (0.14, 0.90),
        (0.175, 1.0),
    ]
    profile = vessel([(height * r, height * h) for r, h in outline], 0.012)
    return [(material, lathe(profile, 64))]


def teapot(material: str, height: float = 0.17) -> Piece:
    """Round pot with lid, spout towards +x and a handle opposite."""
    h = height
    body = lathe(
        np.concatenate(
            [
                [[0, 0]],
                h
                * spline(
                    [
                        (0.36, 0.0),
                        (0.42, 0.03),
                        (0.62, 0.22),
                        (0.66, 0.40),
                        (0.52, 0.62),
                        (0.34, 0.72),
                    ],
                    6,
                ),
                h
                * spline(
                    [(0.345, 0.735), (0.33, 0.75), (0.20, 0.82), (0.06, 0.86), (0.045, 0.89)], 5
                ),
                h * spline([(0.045, 0.89), (0.085, 0.94), (0.07, 0.985), (0.0, 1.0)], 5)[1:],
            ]
        ),
        56,
        crease=50,
    )
    curve = h * spline([(0.50, 0.20, 0), (0.78, 0.30, 0), (0.90, 0.52, 0), (1.06, 0.70, 0)], 8)
    spout = tube(curve, h * np.linspace(0.14, 0.06, len(curve)), 24, 4)
    handle = tube(
        h
        * spline(
            [
                (-0.50, 0.60, 0),
                (-0.78, 0.68, 0),
                (-0.98, 0.54, 0),
                (-0.92, 0.30, 0),
                (-0.58, 0.20, 0),
            ],
            8,
        ),
        0.045 * h,
        14,
    )
    return [(material, part) for part in (body, spout, handle)]


def tray(material: str, radius: float = 0.19) -> Piece:
    """Round tray with a raised, rounded rim; its surface lies at y = 0.004."""
    profile = fillet(
        [
            (0, 0),
            (radius, 0, 0.005),
            (radius + 0.012, 0.020, 0.0012),
            (radius + 0.009, 0.021, 0.0012),
            (radius - 0.003, 0.004, 0.004),
            (0, 0.004),
        ],
        3,
    )
    return [(material, lathe(profile, 64))]
