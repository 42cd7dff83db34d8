"""A dusky room whose only light falls through a door left ajar."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import furniture, textures, vessels
from .furniture import Collection, Piece
from .geometry import Geometry, fillet
from .materials import glass, glaze, light, matte, metal, picture, varnish
from .solids import box, lathe, moulding, quad, tube

DESCRIPTION = "a furnished room lit only through a door slightly open (after Veach)"
CAMERA = {"origin": (-0.42, 1.54, 4.75), "target": (-0.25, 0.74, 0.0), "fov": 55.0}

# Plan of the house [m]: x to the right, z towards the camera; the wall with the door is at z = 0.
LEFT, RIGHT, FRONT, HEIGHT = -2.9, 2.6, 5.6, 2.7
WALL = 0.14
DOOR_LEFT, DOOR_RIGHT, DOOR_TOP = 0.72, 1.57, 2.05
DOOR_ANGLE = 33.0
NEXT_LEFT, NEXT_RIGHT, NEXT_BACK = -1.4, 2.8, -3.6


def slab(low: tuple[float, float, float], high: tuple[float, float, float]) -> Geometry:
    """Sharp box between two corners; its texture coordinates are world positions [m]."""
    a, b = np.array(low), np.array(high)
    solid = box((float(b[0] - a[0]), float(b[1] - a[1]), float(b[2] - a[2])))
    return solid.move(*(0.5 * (a + b)))


def shell() -> Piece:
    """Floor, ceiling and walls of both rooms; materials floor, ceiling, wall, next."""
    t = WALL
    ground = quad(
        (LEFT - t, 0, FRONT + t), (RIGHT - LEFT + 2 * t, 0, 0), (0, 0, NEXT_BACK - FRONT - 2 * t)
    )
    ground = ground.scale_uv((RIGHT - LEFT + 2 * t) / 2.2, (FRONT - NEXT_BACK + 2 * t) / 2.2)
    top = HEIGHT + t
    return [
        ("floor", ground),
        ("ceiling", slab((LEFT - t, HEIGHT, -0.5 * t), (RIGHT + t, top, FRONT + t))),
        ("ceiling", slab((NEXT_LEFT - t, HEIGHT, NEXT_BACK - t), (RIGHT + t, top, -0.5 * t))),
        ("wall", slab((LEFT - t, 0, -t), (DOOR_LEFT, HEIGHT, 0))),
        ("wall", slab((DOOR_RIGHT, 0, -t), (NEXT_RIGHT + t, HEIGHT, 0))),
        ("wall", slab((DOOR_LEFT, DOOR_TOP, -t), (DOOR_RIGHT, HEIGHT, 0))),
        ("wall", slab((LEFT - t, 0, 0), (LEFT, HEIGHT, FRONT))),
        ("wall", slab((RIGHT, 0, 0), (RIGHT + t, HEIGHT, FRONT))),
        ("wall", slab((LEFT - t, 0, FRONT), (RIGHT + t, HEIGHT, FRONT + t))),
        ("next", slab((NEXT_LEFT - t, 0, NEXT_BACK), (NEXT_LEFT, HEIGHT, -t))),
        ("next", slab((NEXT_RIGHT, 0, NEXT_BACK), (NEXT_RIGHT + t, HEIGHT, -t))),
        ("next", slab((NEXT_LEFT - t, 0, NEXT_BACK - t), (NEXT_RIGHT + t, HEIGHT, NEXT_BACK))),
    ]


def joinery() -> Piece:
    """Casing around the doorway, door stops and baseboards; material trim."""
    reveal, width = 0.006, 0.075
    left, right, top = DOOR_LEFT - reveal, DOOR_RIGHT + reveal, DOOR_TOP + reveal
    casing = fillet(
        [
            (width, 0.0),
            (width, 0.016, 0.004),
            (0.055, 0.018, 0.006),
            (0.045, 0.012, 0.006),
            (0.012, 0.012, 0.004),
            (0.006, 0.009, 0.003),
            (0.0, 0.009, 0.002),
            (0.0, 0.0),
        ]
    )
    board = fillet(
        [
            (-0.015, 0.0),
            (-0.015, 0.075, 0.003),
            (-0.009, 0.088, 0.004),
            (-0.004, 0.096, 0.003),
            (0.0, 0.096),
        ]
    )
    runs: list[list[tuple[float, float]]] = [
        [(FRONT, LEFT), (0.0, LEFT), (0.0, left - width)],
        [(0.0, right + width), (0.0, RIGHT), (FRONT, RIGHT)],
    ]
    stop = 0.012
    return [
        (
            "trim",
            moulding([(right, 0.0), (right, top), (left, top), (left, 0.0)], casing, closed=False),
        ),
        *(("trim", moulding(run[::-1], board[::-1] * [-1, 1], "zx", closed=False)) for run in runs),
        ("trim", slab((DOOR_LEFT, 0, -0.10), (DOOR_LEFT + stop, DOOR_TOP, -0.046))),
        ("trim", slab((DOOR_RIGHT - stop, 0, -0.10), (DOOR_RIGHT, DOOR_TOP, -0.046))),
        (
            "trim",
            slab((DOOR_LEFT + stop, DOOR_TOP - stop, -0.10), (DOOR_RIGHT - stop, DOOR_TOP, -0.046)),
        ),
    ]


def door() -> Piece:
    """
    The leaf, closed, hinged at the origin and reaching to -x; materials leaf, handle.

    Its face towards the room lies in z = 0. Two recessed panels with mouldings.
    """
    width, height, thick, rail = DOOR_RIGHT - DOOR_LEFT - 0.008, DOOR_TOP - 0.010, 0.04, 0.12
    z, low, middle = -0.5 * thick, 0.22, 0.98
    inner = width - 2 * rail
    solid = [
        box((rail, height, thick), 0.002).move(-0.5 * rail, 0.5 * height, z),
        box((rail, height, thick), 0.002).move(-width + 0.5 * rail, 0.5 * height, z),
    ]
    for bottom, top in [(0.0, low), (middle - 0.07, middle + 0.07), (height - rail, height)]:
        solid.append(
            box((inner, top - bottom, thick), 0.002).move(-0.5 * width, 0.5 * (bottom + top), z)
        )
    bead = fillet(
        [
            (0.0, 0.0),
            (0.0, 0.013, 0.002),
            (-0.008, 0.013, 0.003),
            (-0.020, 0.003, 0.004),
            (-0.020, 0.0),
        ]
    )
    for bottom, top in [(low, middle - 0.07), (middle + 0.07, height - rail)]:
        # The panel is let into the frame by 5 mm, as a joiner does, so no light gets past.
        solid.append(
            box((inner + 0.01, top - bottom + 0.01, 0.012)).move(
                -0.5 * width, 0.5 * (bottom + top), z
            )
        )
        a, b = 0.5 * inner, 0.5 * (top - bottom)
        ring = moulding([(-a, -b), (a, -b), (a, b), (-a, b)], bead)
        for turn, face in [(0.0, z + 0.006), (180.0, z - 0.006)]:
            solid.append(ring.rotate("y", turn).move(-0.5 * width, 0.5 * (bottom + top), face))
    parts: Piece = [("leaf", part.move(y=0.005)) for part in solid]

    rose = lathe(
        fillet(
            [
                (0, 0),
                (0.026, 0),
                (0.026, 0.006, 0.003),
                (0.010, 0.009, 0.002),
                (0.010, 0.012),
                (0, 0.012),
            ]
        ),
        40,
    )
    lever = tube(
        np.concatenate(
            [
                [(0, 0, 0.010), (0, 0, 0.036)],
                np.array(
                    [
                        (0.0105 * (1 - np.cos(t)), 0, 0.036 + 0.0105 * np.sin(t))
                        for t in np.linspace(0.3, 0.5 * np.pi, 5)
                    ]
                ),
                [(0.06, -0.001, 0.0465), (0.118, -0.003, 0.0445)],
            ]
        ),
        0.0085,
        16,
    )
    mirrored = Geometry(
        lever.positions * [-1, 1, 1], lever.normals * [-1, 1, 1], lever.uv, lever.faces[:, ::-1]
    )
    for turn, face, grip in [(0.0, 0.0, lever), (180.0, -thick, mirrored)]:
        for part in (rose.rotate("x", 90), grip):
            parts.append(("handle", part.rotate("y", turn).move(-width + 0.06, 1.02, face)))
    return parts


def contents() -> Collection:
    """Everything that furnishes the room."""
    room = Collection()
    room.add(shell())
    room.add(joinery())
    top = 0.80
    board = furniture.sideboard(1.95, top, 0.44)
    room.add([(m, g.scale_uv(1.1, 2.4)) for m, g in board], (-1.22, 0, 0.02))
    room.add(furniture.framed_picture(0.84, 0.56), (-1.24, 1.56, 0.0))
    room.add(furniture.table_lamp(), (-1.94, top, 0.24))
    room.add(
        furniture.books(
            [
                ("red", 0.25, 0.034, 0.18, 4.0),
                ("cream", 0.23, 0.026, 0.165, -7.0),
                ("navy", 0.21, 0.030, 0.15, 9.0),
            ]
        ),
        (-1.50, top, 0.24),
    )
    room.add(vessels.cup("porcelain"), (-1.50, top + 0.09, 0.24), 35)
    room.add(vessels.decanter(), (-1.17, top + 0.0003, 0.17))
    room.add(vessels.decanter(0.75), (-1.07, top + 0.0003, 0.31))
    room.add(vessels.bowl("brass", 0.165), (-0.80, top, 0.25))
    room.add(vessels.vase("porcelain", 0.36), (-0.44, top, 0.20))
    room.add(vessels.branches(0.78, 0.34), (-0.44, top + 0.10, 0.20), 20)
    rug = box((2.3, 0.009, 1.6), 0.004).move_uv(1.15, 0.8).scale_uv(1 / 2.3, 1 / 1.6)
    room.add([("rug", rug.move(y=0.0045))], (-1.05, 0, 1.62))
    room.add(furniture.stool(), (-0.48, 0.009, 1.52), 12)
    tea = 0.009 + 0.372
    room.add(vessels.tray("metal", 0.195), (-0.48, tea, 1.52))
    room.add(vessels.teapot("copper", 0.17), (-0.52, tea + 0.004, 1.49), 28)
    room.add(vessels.cup("porcelain"), (-0.40, tea + 0.004, 1.60), -40)
    room.add(vessels.amphora("terracotta"), (2.13, 0, 0.36))
    return room


def build() -> dict[str, Any]:
    """Shapes and lights. The leaf of the door is ``door_leaf``, its handles ``door_handle``."""
    wood = varnish(picture(textures.veneer()), 0.18)
    materials = {
        "floor": varnish(picture(textures.planks()), 0.16),
        "ceiling": matte((0.78, 0.77, 0.74)),
        "wall": matte((0.66, 0.70, 0.69)),
        "next": matte((0.50, 0.46, 0.40)),
        "trim": varnish((0.74, 0.73, 0.70), 0.25),
        "leaf": varnish((0.72, 0.71, 0.68), 0.2),
        "handle": metal("Ag", 0.15),
        "metal": metal("Au", 0.18),
        "brass": metal("Au", 0.12),
        "copper": metal("Cu", 0.1),
        "wood": wood,
        "frame": metal("Au", 0.3),
        "mount": matte((0.80, 0.79, 0.75)),
        "canvas": matte(picture(textures.landscape())),
        "clay": varnish((0.05, 0.22, 0.20), 0.08),
        "fabric": matte((0.72, 0.66, 0.55)),
        "red": varnish((0.42, 0.06, 0.05), 0.3),
        "cream": varnish((0.68, 0.58, 0.40), 0.3),
        "navy": varnish((0.05, 0.09, 0.20), 0.3),
        "paper": matte((0.76, 0.72, 0.62)),
        "porcelain": glaze((0.78, 0.78, 0.76)),
        "glass": glass(),
        "twig": matte((0.20, 0.13, 0.09)),
        "bud": matte((0.75, 0.45, 0.42)),
        "rug": matte(picture(textures.rug())),
        "cushion": matte((0.58, 0.36, 0.07)),
        "terracotta": varnish((0.50, 0.20, 0.11), 0.35),
    }
    leaf = Collection()
    leaf.add(door(), (DOOR_RIGHT - 0.004, 0.0, 0.0), DOOR_ANGLE)
    return {
        **contents().shapes(materials),
        **leaf.shapes(materials, "door_"),
        "light": light((2.45, 2.2, -2.15), (0.75, 0.6, 0.0), (0.6, 0.6), (3000.0, 2460.0, 1800.0)),
    }
