"""Pictures computed in NumPy: wood, a painting, a rug, stone, and a sky.

Each function returns (height, width, 3) float64, row 0 at the top. All but `sky` are sRGB-encoded
values in [0, 1].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .geometry import Array, normalize
from .noise import fractal, hash01, value_noise


def _grid(width: int, height: int) -> tuple[Array, Array]:
    """Pixel centres in [0, 1): x to the right, y downwards."""
    x = (np.arange(width) + 0.5) / width
    y = (np.arange(height) + 0.5) / height
    return np.broadcast_to(x, (height, width)), np.broadcast_to(y[:, None], (height, width))


def _ramp(t: Array, stops: list[tuple[float, tuple[float, float, float]]]) -> Array:
    """Piecewise linear colour map."""
    at = [s[0] for s in stops]
    return np.stack([np.interp(t, at, [s[1][k] for s in stops]) for k in range(3)], axis=-1)


def _mix(a: ArrayLike, b: ArrayLike, t: Array) -> Array:
    weight = t[..., None]
    return np.asarray(np.asarray(a) * (1 - weight) + np.asarray(b) * weight)


def planks(size: int = 768, rows: int = 14, seed: int = 3) -> Array:
    """Floorboards along x; tiles in both directions."""
    x, y = _grid(size, size)
    row = np.floor(y * rows).astype(np.int64)
    # Two boards per row, with joints that differ from row to row.
    along = 2.0 * (x + hash01(row, 7, seed))
    board = np.floor(along).astype(np.int64) % 2 + 2 * row
    tone = hash01(board, 1, seed)
    shift = np.floor(hash01(board, 2, seed) * 64)
    bend = 1.5 * fractal(x * 4 + shift, y * rows, 3, seed + 1)
    grain = fractal(x * 6 + shift, y * rows * 9 + 2.5 * bend + shift, 4, seed + 2)
    fibre = fractal(x * 24 + shift, y * rows * 40, 2, seed + 3)
    value = np.clip(0.2 + 0.55 * grain + 0.2 * fibre + 0.36 * (tone - 0.5), 0, 1)
    colour = _ramp(
        value, [(0.15, (0.30, 0.18, 0.10)), (0.5, (0.52, 0.35, 0.21)), (0.85, (0.68, 0.50, 0.33))]
    )
    across = np.abs(y * rows - row - 0.5) * 2
    joint = np.maximum(across > 0.965, np.abs((along % 1.0) - 0.5) > 0.4985)
    return np.asarray(colour * np.where(joint, 0.42, 1.0)[..., None])


def veneer(size: int = 512, seed: int = 11) -> Array:
    """Dark walnut, grain along x."""
    x, y = _grid(size, size)
    bend = fractal(x * 2, y * 3, 3, seed, period=None)
    ring = 0.5 + 0.5 * np.sin(2 * np.pi * (7 * y + 1.6 * bend))
    fibre = fractal(x * 8, y * 160, 3, seed + 1)
    value = np.clip(0.25 * ring + 0.55 * fibre + 0.2 * fractal(x * 3, y * 24, 4, seed + 2), 0, 1)
    return _ramp(
        value, [(0.15, (0.24, 0.14, 0.09)), (0.5, (0.40, 0.25, 0.16)), (0.85, (0.55, 0.37, 0.25))]
    )


def landscape(width: int = 600, height: int = 400, seed: int = 21) -> Array:
    """A lake between hills at dawn, painted in layers."""
    x, y = _grid(width, height)
    aspect = width / height

    def scenery(v: Array) -> Array:
        cloud = fractal(x * 4 * aspect + 9, v * 15, 5, seed)
        colour = _ramp(
            v,
            [
                (0.0, (0.30, 0.45, 0.64)),
                (0.28, (0.62, 0.70, 0.76)),
                (0.46, (0.95, 0.80, 0.60)),
                (0.60, (0.98, 0.66, 0.42)),
            ],
        )
        colour = _mix(colour, (1.0, 0.93, 0.84), np.clip((cloud - 0.5) * 3.5, 0, 0.75))
        sun = (x - 0.66) ** 2 * aspect**2 + (v - 0.435) ** 2
        colour = _mix(colour, (1.0, 0.95, 0.78), 0.75 * np.exp(-sun / 0.006))
        colour = _mix(colour, (1.0, 0.98, 0.90), (sun < 0.0011).astype(np.float64))
        ridges = [
            (0.44, 0.20, 2.5, (0.60, 0.62, 0.70)),
            (0.50, 0.17, 3.5, (0.42, 0.50, 0.56)),
            (0.555, 0.13, 5.0, (0.26, 0.38, 0.36)),
            (0.60, 0.07, 8.0, (0.15, 0.25, 0.18)),
        ]
        for k, (base, rise, scale, tint) in enumerate(ridges):
            crest = base - rise * (fractal(x[:1] * scale, 0.0, 6, seed + 10 * k + 1) - 0.42)
            shade = 0.86 + 0.28 * fractal(x * 30 * aspect, v * 60, 3, seed + k)
            haze = np.clip((v - crest) * (3.0 - 0.6 * k), 0, 0.5)
            layer = _mix(np.asarray(tint) * shade[..., None], (0.93, 0.78, 0.64), haze)
            colour = _mix(colour, layer, np.clip((v - crest) * 260, 0, 1))
        return colour

    shore = 0.62
    ripple = (value_noise(x * 14 * aspect, y * 150, seed + 50) - 0.5) * (y - shore) * 0.35
    mirrored = np.clip(2 * shore - y + ripple, 0.0, shore)
    water = scenery(mirrored) * np.array([0.80, 0.86, 0.92])
    picture = np.where((y < shore)[..., None], scenery(y), water)
    bank = 0.90 - 0.10 * np.cos(4.2 * (x - 0.1)) + 0.03 * fractal(x[:1] * 24, 0.0, 4, seed + 60)
    grass = _ramp(
        fractal(x * 90 * aspect, y * 28, 4, seed + 61),
        [(0.25, (0.10, 0.13, 0.06)), (0.6, (0.30, 0.30, 0.12)), (0.85, (0.62, 0.50, 0.22))],
    )
    picture = _mix(picture, grass, np.clip((y - bank) * 200, 0, 1))
    canvas = 0.95 + 0.10 * value_noise(x * width / 3, y * height / 3, seed + 62)
    return np.clip(picture * canvas[..., None], 0, 1)


def rug(width: int = 640, height: int = 448, seed: int = 31) -> Array:
    """A woven rug: bordered field of stepped diamonds."""
    x, y = _grid(width, height)
    px, py = x * width / 64, y * height / 64
    edge = np.minimum(np.minimum(px, width / 64 - px), np.minimum(py, height / 64 - py))
    step = 8.0
    sx, sy = np.floor(px * step) / step, np.floor(py * step) / step
    diamond = np.abs(sx % 2.0 - 1.0) + np.abs((sy + 1.5) % 2.0 - 1.0)
    red, navy = (0.47, 0.13, 0.11), (0.12, 0.16, 0.26)
    cream, ochre = (0.80, 0.72, 0.57), (0.70, 0.48, 0.20)
    colour = np.broadcast_to(np.asarray(red), (height, width, 3))
    for limit, tint in [(0.95, navy), (0.72, cream), (0.6, red), (0.36, ochre), (0.2, navy)]:
        colour = _mix(colour, tint, (diamond < limit).astype(np.float64))
    teeth = (np.abs((sx + sy) % 0.5 - 0.25) < 0.125).astype(np.float64)
    for inner, tint in [(0.95, cream), (0.88, navy)]:
        colour = _mix(colour, tint, (edge < inner).astype(np.float64))
    colour = _mix(colour, ochre, teeth * (edge < 0.74) * (edge > 0.42))
    for inner, tint in [(0.30, cream), (0.22, red)]:
        colour = _mix(colour, tint, (edge < inner).astype(np.float64))
    weave = 0.82 + 0.3 * hash01(np.floor(x * width), np.floor(y * height), seed)
    wear = 0.9 + 0.2 * fractal(x * 5, y * 5, 4, seed + 1)
    return np.clip(colour * (weave * wear)[..., None], 0, 1)


def flagstones(size: int = 768, rows: int = 6, seed: int = 41) -> Array:
    """Square stone slabs with joints; tiles in both directions."""
    x, y = _grid(size, size)
    i, j = np.floor(x * rows).astype(np.int64), np.floor(y * rows).astype(np.int64)
    tone = hash01(i, j, seed)
    cloud = fractal(x * 4 * rows, y * 4 * rows, 6, seed + 1, period=4 * rows)
    value = np.clip(0.25 + 0.5 * cloud + 0.35 * (tone - 0.5), 0, 1)
    colour = _ramp(
        value, [(0.1, (0.50, 0.44, 0.37)), (0.5, (0.70, 0.63, 0.53)), (0.9, (0.84, 0.78, 0.68))]
    )
    edge = np.maximum(np.abs(x * rows - i - 0.5), np.abs(y * rows - j - 0.5))
    rough = 0.008 * (fractal(x * 60, y * 60, 3, seed + 2, period=60) - 0.5)
    return np.asarray(colour * np.where(edge + rough > 0.485, 0.5, 1.0)[..., None])


def sky(
    width: int,
    sun: ArrayLike,
    sun_radiance: float,
    sun_radius: float,
) -> Array:
    """
    Latitude-longitude radiance map in linear RGB: a clear sky, haze, a sun, and dim ground.

    Parameters
    ----------
    width : columns; the map has width / 2 rows. The top row is up (+y).
    sun : direction towards the sun, (3,)
    sun_radiance : added inside the sun's disc [W m^-2 sr^-1, relative]
    sun_radius : angular radius of the disc [degrees]
    """
    x, y = _grid(width, width // 2)
    # Mitsuba's envmap looks up u = atan2(x, -z) / 2 pi, v = acos(y) / pi.
    phi, theta = 2 * np.pi * x, np.pi * y
    direction = np.stack(
        [np.sin(phi) * np.sin(theta), np.cos(theta), -np.cos(phi) * np.sin(theta)], axis=-1
    )
    towards = normalize(np.asarray(sun, dtype=np.float64))
    cosine = np.clip(direction @ towards, -1, 1)
    up = direction[..., 1]
    colour = _ramp(
        np.clip(up, 0, 1),
        [
            (0.0, (0.95, 0.88, 0.78)),
            (0.12, (0.66, 0.78, 0.92)),
            (0.45, (0.26, 0.46, 0.80)),
            (1.0, (0.11, 0.26, 0.60)),
        ],
    )
    cloud = fractal(
        direction[..., 0] / (np.abs(up) + 0.25) * 1.5 + 40,
        direction[..., 2] / (np.abs(up) + 0.25) * 1.5 + 40,
        6,
        51,
    )
    colour = _mix(colour, (0.95, 0.96, 1.0), np.clip((cloud - 0.52) * 3, 0, 0.6) * (up > 0))
    glow = np.exp((cosine - 1) * 12) * 0.9 + np.exp((cosine - 1) * 120) * 1.8
    colour = colour + glow[..., None] * np.array([1.0, 0.85, 0.62])
    colour = np.where((up < 0)[..., None], np.array([0.16, 0.14, 0.12]), colour)
    # A soft rim one pixel wide keeps the sun's power nearly independent of the resolution.
    pixel = 2 * np.pi / width
    disc = np.clip((np.deg2rad(sun_radius) - np.arccos(cosine)) / pixel + 0.5, 0, 1)
    return np.asarray(colour + (sun_radiance * disc)[..., None] * np.array([1.0, 0.86, 0.68]))
