"""A cloister in the sun, seen from the shade of its arcade."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

from . import textures, vessels
from .furniture import Collection, Piece
from .geometry import Geometry, fillet, grid_faces, merge, profile_strip
from .materials import matte, metal, picture, rgb, varnish
from .noise import fractal
from .solids import box, lathe, moulding, pillow, quad

DESCRIPTION = "a courtyard with arcades under a sunlit sky (environment light only)"
CAMERA = {"origin": (-1.0, 1.55, 6.6), "target": (-0.72, 1.72, 0.0), "fov": 66.0}

# Plan [m]: the open court is a square of 2 * COURT, a gallery of width GALLERY around it.
COURT, GALLERY, BAYS = 4.0, 2.4, 4
SPRING, RADIUS, THICK, TOP = 2.15, 0.80, 0.40, 3.75
SUN = (0.50, 0.80, 0.28)


def arcade() -> Piece:
    """One side of the court: arches on columns along x, its inner face in z = 0; material stone."""
    bay = 2 * COURT / BAYS
    angles = np.linspace(np.pi, 0.0, 25)
    curve: list[tuple[float, float]] = [(-COURT, SPRING)]
    for k in range(BAYS):
        middle = -COURT + (k + 0.5) * bay
        curve += [
            (float(middle + RADIUS * np.cos(a)), float(SPRING + RADIUS * np.sin(a))) for a in angles
        ]
    curve.append((COURT, SPRING))
    lower = np.array(curve)
    count = len(lower)
    parts: list[Geometry] = []
    for z, sign in [(0.0, 1.0), (-THICK, -1.0)]:
        flat = np.concatenate([lower, np.stack([lower[:, 0], np.full(count, TOP)], 1)])
        position = np.concatenate([flat, np.full((2 * count, 1), z)], axis=1)
        normal = np.broadcast_to(np.array([0.0, 0.0, sign]), position.shape)
        faces = grid_faces(2, count)
        parts.append(Geometry(position, normal, flat, faces[:, ::-1] if sign > 0 else faces))
    points, normals, starts = profile_strip(lower)
    rows = len(points)
    position = np.concatenate([np.column_stack([points, np.full(rows, z)]) for z in (0, -THICK)])
    normal = np.tile(np.column_stack([normals, np.zeros(rows)]), (2, 1))
    uv = np.column_stack([position[:, 2], position[:, 0]])
    faces = np.array(
        [[[i, rows + i, rows + i + 1], [i, rows + i + 1, i + 1]] for i in starts]
    ).reshape(-1, 3)
    parts.append(Geometry(position, normal, uv, faces))
    ring = fillet([(0.07, 0.0), (0.07, 0.045, 0.015), (0.0, 0.045, 0.01), (0.0, 0.0)])
    for k in range(BAYS):
        middle = -COURT + (k + 0.5) * bay
        arch = [
            (middle + RADIUS * np.cos(a), SPRING + RADIUS * np.sin(a))
            for a in np.linspace(0.0, np.pi, 25)
        ]
        parts.append(moulding(arch, ring, closed=False))
    columns = [-COURT + k * bay for k in range(1, BAYS)]
    return [
        ("stone", merge(parts)),
        *(
            (material, geometry.move(x, 0, -0.5 * THICK))
            for x in columns
            for material, geometry in column()
        ),
    ]


def column() -> Piece:
    """A round column with base and capital, SPRING high; materials marble, stone."""
    plinth, abacus = 0.12, 0.10
    shaft = lathe(
        fillet(
            [
                (0, plinth),
                (0.165, plinth),
                (0.165, plinth + 0.07, 0.03),
                (0.130, plinth + 0.09, 0.01),
                (0.128, plinth + 0.12, 0.01),
                (0.110, SPRING - 0.42),
                (0.124, SPRING - 0.41, 0.01),
                (0.124, SPRING - 0.38, 0.01),
                (0.112, SPRING - 0.37, 0.01),
                (0.118, SPRING - 0.26, 0.05),
                (0.180, SPRING - abacus - 0.02, 0.03),
                (0.180, SPRING - abacus),
                (0, SPRING - abacus),
            ],
            2,
        ),
        28,
    )
    return [
        ("marble", shaft),
        ("stone", box((0.38, plinth, 0.38), 0.012).move(y=0.5 * plinth)),
        ("stone", box((0.40, abacus, 0.40), 0.012).move(y=SPRING - 0.5 * abacus)),
    ]


def pier() -> Piece:
    """Corner of two arcades; materials stone."""
    a = THICK
    return [
        ("stone", box((a, TOP, a)).move(-COURT - 0.5 * a, 0.5 * TOP, -COURT - 0.5 * a)),
        (
            "stone",
            box((a + 0.06, 0.16, a + 0.06), 0.012).move(
                -COURT - 0.5 * a, SPRING - 0.08, -COURT - 0.5 * a
            ),
        ),
    ]


def gallery() -> Piece:
    """Outer wall, ceiling and roof edge of one side (at -z); materials plaster, beam, tile."""
    outer = COURT + THICK + GALLERY
    back = quad((-outer, 0, -outer), (2 * outer, 0, 0), (0, TOP, 0))
    inner = COURT + THICK
    deck = box((2 * outer, 0.2, outer - COURT)).move(0, TOP + 0.1, -0.5 * (outer + COURT))
    parts: Piece = [("plaster", back.scale_uv(2 * outer, TOP)), ("plaster", deck)]
    joists = np.arange(-inner + 0.3, inner, 0.62)
    parts += [
        (
            "beam",
            box((0.12, 0.16, GALLERY - 0.02), 0.008, 1).move(
                float(x), TOP - 0.08, -inner - 0.5 * GALLERY
            ),
        )
        for x in joists
    ]
    return parts


def fountain() -> Piece:
    """Octagonal basin with a bronze bowl on a stem; materials stone, marble, bronze, water."""
    corners = [(1.05 * np.cos(t), 1.05 * np.sin(t)) for t in np.deg2rad(22.5 + 45 * np.arange(8))]
    rim = fillet(
        [
            (0.0, 0.0),
            (0.0, 0.36, 0.0),
            (0.03, 0.38, 0.01),
            (0.03, 0.44, 0.015),
            (-0.16, 0.44, 0.015),
            (-0.16, 0.38, 0.01),
            (-0.13, 0.36),
            (-0.13, 0.0),
        ]
    )
    basin = moulding(corners, rim, "zx")
    stem = lathe(
        fillet(
            [
                (0, 0),
                (0.20, 0),
                (0.20, 0.45, 0.02),
                (0.10, 0.55, 0.06),
                (0.075, 0.80, 0.05),
                (0.12, 0.92, 0.02),
                (0, 0.92),
            ]
        ),
        40,
    )
    dish = vessels.bowl("bronze", 0.46, 0.014)
    water = lathe([(0.93, 0.33), (0.0, 0.33)], 32)
    return [
        ("stone", basin),
        ("marble", stem),
        ("water", water),
        *((m, g.move(y=0.92)) for m, g in dish),
    ]


def topiary(seed: int) -> Piece:
    """Clipped round shrub in a clay pot; materials clay, leaf, beam."""
    pot = lathe(
        vessels.vessel([(0.19, 0), (0.20, 0.02), (0.27, 0.36), (0.295, 0.37), (0.295, 0.43)], 0.02),
        44,
    )
    soil = lathe([(0.262, 0.37), (0.0, 0.39)], 32)
    trunk = lathe([(0.03, 0.38), (0.025, 0.75), (0, 0.75)], 12)
    ball = pillow((0.86, 0.86, 0.86), 2.0, 24)
    p = ball.positions
    noise = fractal(p[:, 0] * 13 + p[:, 2] * 4, p[:, 1] * 13 - p[:, 2] * 9, 3, seed)
    bump = 1 + 0.16 * (noise - 0.5)
    leaves = Geometry(p * bump[:, None], ball.normals, ball.uv, ball.faces)
    return [("clay", pot), ("beam", soil), ("beam", trunk), ("leaf", leaves.move(y=1.05))]


def build() -> dict[str, Any]:
    """Shapes and the environment light."""
    stone = matte((0.66, 0.56, 0.43))
    outer = COURT + THICK + GALLERY
    materials = {
        "paving": varnish(picture(textures.flagstones(), (2 * outer / 3.6, 2 * outer / 3.6)), 0.3),
        "stone": stone,
        "marble": varnish((0.72, 0.66, 0.58), 0.25),
        "plaster": matte((0.70, 0.50, 0.33)),
        "beam": matte((0.19, 0.12, 0.07)),
        "bronze": {**metal("Cu", 0.2), "specular_reflectance": rgb((0.75, 0.66, 0.50))},
        "water": {
            "type": "roughconductor",
            "material": "none",
            "alpha": 0.03,
            "specular_reflectance": rgb((0.25, 0.32, 0.32)),
        },
        "clay": varnish((0.48, 0.20, 0.11), 0.4),
        "leaf": matte((0.07, 0.16, 0.035)),
    }
    place = Collection()
    place.add([("paving", quad((-outer, 0, outer), (2 * outer, 0, 0), (0, 0, -2 * outer)))])
    cornice = fillet(
        [
            (-0.0, TOP - 0.16),
            (-0.05, TOP - 0.14, 0.02),
            (-0.06, TOP - 0.04, 0.03),
            (-0.13, TOP - 0.02, 0.01),
            (-0.13, TOP + 0.20, 0.01),
            (0.0, TOP + 0.20),
        ]
    )
    square = [(-COURT, -COURT), (COURT, -COURT), (COURT, COURT), (-COURT, COURT)]
    place.add([("stone", moulding(square, cornice[::-1], "zx"))])
    for k in range(4):
        turn = 90.0 * k
        place.add([(m, g.move(z=-COURT)) for m, g in arcade()], turn=turn)
        place.add(pier(), turn=turn)
        place.add(gallery(), turn=turn)
    place.add(fountain(), (-0.25, 0, 0.3))
    for k, (x, z) in enumerate([(-2.95, -2.95), (2.95, -2.95), (-2.95, 2.6)]):
        place.add(topiary(60 + k), (x, 0, z))
    place.add(vessels.amphora("clay", 0.75), (-3.2, 0, 4.9))
    radiance = textures.sky(768, SUN, 7000.0, 1.3).astype(np.float32)
    return {
        **place.shapes(materials),
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(radiance))},
    }
