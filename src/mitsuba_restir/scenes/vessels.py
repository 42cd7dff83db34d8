"""Vessels turned on a lathe, each standing on y = 0 at the origin: vases, bowls, bottles, pots."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .furniture import Piece
from .geometry import Array, fillet, spline
from .noise import hash01
from .solids import lathe, pillow, tube


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
