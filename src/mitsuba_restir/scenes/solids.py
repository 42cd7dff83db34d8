"""Solids to furnish a scene with: boxes with rounded edges, lathes, tubes, mouldings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .geometry import (
    Array,
    Geometry,
    drop_degenerate,
    grid_faces,
    merge,
    normalize,
    profile_strip,
)


def _cube(
    ticks: tuple[Array, Array, Array], place: Callable[[Array], tuple[Array, Array]]
) -> Geometry:
    """
    Mesh the surface of a cube and move it into place.

    ``ticks`` holds the grid lines along each axis; ``place`` maps (N, 3) cube points to positions
    and normals. The texture coordinates are the positions projected along the axis of the face.
    """
    sides = []
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        for end in (0, -1):
            point = np.empty((len(ticks[b]), len(ticks[c]), 3))
            point[..., axis] = ticks[axis][end]
            point[..., b], point[..., c] = np.meshgrid(ticks[b], ticks[c], indexing="ij")
            faces = grid_faces(*point.shape[:2])
            position, normal = place(point.reshape(-1, 3))
            horizontal, vertical = {0: (2, 1), 1: (0, 2), 2: (0, 1)}[axis]
            uv = position[:, [horizontal, vertical]]
            # grid_faces winds from the first index to the second: b to c, hence inward at end 0
            sides.append(Geometry(position, normal, uv, faces[:, ::-1] if end == -1 else faces))
    return merge(sides)


def box(size: tuple[float, float, float], radius: float = 0.0, steps: int = 2) -> Geometry:
    """
    Axis-aligned box centred at the origin, with rounded edges.

    Parameters
    ----------
    size : edge lengths [m]
    radius : radius of the edges [m]; zero for sharp ones
    steps : chords per half quarter-circle
    """
    half = 0.5 * np.asarray(size, dtype=np.float64)
    if radius == 0.0:
        edge = [np.array([-h, h]) for h in half]
        flat = _cube((edge[0], edge[1], edge[2]), lambda p: (p, p))
        normals = np.stack([sign * np.eye(3)[a] for a in range(3) for sign in (-1.0, 1.0)])
        return replace(flat, normals=np.repeat(normals, 4, axis=0))
    radius = min(radius, 0.999 * float(half.min()))
    inner = half - radius
    arc = radius * np.tan(np.linspace(0.0, 0.25 * np.pi, steps + 1))
    ticks = [np.concatenate([-(h + arc)[::-1], h + arc]) for h in inner]

    def place(point: Array) -> tuple[Array, Array]:
        core = np.clip(point, -inner, inner)
        normal = normalize(point - core)
        return core + radius * normal, normal

    return _cube((ticks[0], ticks[1], ticks[2]), place)


def pillow(size: tuple[float, float, float], power: float = 4.0, steps: int = 16) -> Geometry:
    """
    Superellipsoid |x/a|^p + |y/b|^p + |z/c|^p = 1: a ball at p = 2, a soft box at p = 5.

    Parameters
    ----------
    size : full extents [m]
    power : exponent p
    steps : grid cells along each edge of the cube it is projected from
    """
    half = 0.5 * np.asarray(size, dtype=np.float64)
    tick = np.tan(np.linspace(-0.25 * np.pi, 0.25 * np.pi, steps + 1))

    def place(point: Array) -> tuple[Array, Array]:
        unit = point / (np.abs(point) ** power).sum(1, keepdims=True) ** (1.0 / power)
        gradient = np.sign(unit) * np.abs(unit) ** (power - 1.0) / half
        return unit * half, normalize(gradient)

    return _cube((tick, tick, tick), place)


def lathe(profile: ArrayLike, segments: int = 48, crease: float = 40.0) -> Geometry:
    """
    Turn a profile about the y axis.

    Parameters
    ----------
    profile : (K, 2) rows (radius, height) [m], the outside to the right of the direction of
        travel: from the axis outwards along the underside, up, and back to the axis
    segments : number of facets around the axis
    crease : corners sharper than this stay sharp [degrees]
    """
    points, normals, starts = profile_strip(profile, crease)
    angle = np.linspace(0.0, 2 * np.pi, segments + 1)
    c, s = np.cos(angle), np.sin(angle)
    # A smooth surface that ends on the axis has a normal along it.
    for end in (0, -1):
        if points[end, 0] == 0.0 and abs(normals[end, 1]) > 0.8:
            normals[end] = [0.0, np.sign(normals[end, 1])]
    position = np.stack(
        [
            np.outer(points[:, 0], c),
            np.outer(points[:, 1], np.ones_like(c)),
            np.outer(points[:, 0], -s),
        ],
        axis=-1,
    )
    normal = np.stack(
        [
            np.outer(normals[:, 0], c),
            np.outer(normals[:, 1], np.ones_like(c)),
            np.outer(normals[:, 0], -s),
        ],
        axis=-1,
    )
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    uv = np.stack(np.broadcast_arrays(angle / (2 * np.pi), length[:, None]), axis=-1)
    columns = segments + 1
    strips = [grid_faces(2, columns) + i * columns for i in starts]
    return drop_degenerate(
        Geometry(
            position.reshape(-1, 3),
            normal.reshape(-1, 3),
            uv.reshape(-1, 2),
            np.concatenate(strips),
        )
    )


def tube(path: ArrayLike, radii: ArrayLike, segments: int = 12, cap: int = 3) -> Geometry:
    """
    Round tube along a curve, with hemispherical ends.

    Parameters
    ----------
    path : (K, 3) points [m]
    radii : radius, or (K,) radii [m]
    segments : facets around
    cap : rings per hemisphere
    """
    p = np.asarray(path, dtype=np.float64)
    r = np.broadcast_to(np.asarray(radii, dtype=np.float64), len(p))
    tangent = normalize(np.gradient(p, axis=0))
    angles = np.linspace(0.5 * np.pi, 0.0, cap, endpoint=False)
    begin = p[0] - np.outer(np.sin(angles) * r[0], tangent[0])
    end = p[-1] + np.outer(np.sin(angles[::-1]) * r[-1], tangent[-1])
    centres = np.concatenate([begin, p, end])
    rings = np.concatenate([np.cos(angles) * r[0], r, np.cos(angles[::-1]) * r[-1]])
    axes = np.concatenate(
        [np.repeat(tangent[:1], cap, 0), tangent, np.repeat(tangent[-1:], cap, 0)]
    )
    tilt = np.concatenate([-np.sin(angles), np.zeros(len(p)), np.sin(angles[::-1])])[:, None]

    # Parallel transport: each frame is the one before, made orthogonal to the new tangent.
    side = normalize(np.cross(axes[0], np.eye(3)[np.argmin(np.abs(axes[0]))]))
    sides = []
    for axis in axes:
        side = normalize(side - (side @ axis) * axis)
        sides.append(side)
    u = np.array(sides)
    v = np.cross(axes, u)
    angle = np.linspace(0.0, 2 * np.pi, segments + 1)[:, None]
    radial = np.cos(angle)[None] * u[:, None] + np.sin(angle)[None] * v[:, None]
    position = centres[:, None] + rings[:, None, None] * radial
    normal = normalize(radial * np.sqrt(1 - tilt**2)[:, None] + (tilt * axes)[:, None])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1))])
    uv = np.stack(np.broadcast_arrays(angle.T / (2 * np.pi), length[:, None]), axis=-1)
    faces = grid_faces(len(centres), segments + 1)
    return drop_degenerate(
        Geometry(position.reshape(-1, 3), normal.reshape(-1, 3), uv.reshape(-1, 2), faces)
    )


def moulding(
    path: ArrayLike,
    profile: ArrayLike,
    plane: Literal["xy", "zx"] = "xy",
    closed: bool = True,
    crease: float = 40.0,
) -> Geometry:
    """
    Sweep a profile along a polyline with mitred corners: frames, casings, baseboards.

    Parameters
    ----------
    path : (K, 2) points in the plane [m]; walk it counter-clockwise around a frame's opening
    profile : (L, 2) rows (outward, height): distance to the right of the path and above the plane.
        Its outside is to the right of the direction of travel.
    plane : ``'xy'`` (height along +z) or ``'zx'`` (height along +y)
    closed : whether the path returns to its start
    crease : corners of the profile sharper than this stay sharp [degrees]
    """
    line = np.asarray(path, dtype=np.float64)
    points, normals, starts = profile_strip(profile, crease)
    following = np.roll(line, -1, axis=0) if closed else line[1:]
    direction = normalize(following - line[: len(following)])
    right = np.stack([direction[:, 1], -direction[:, 0]], axis=1)
    if closed:
        before, after = np.roll(right, 1, axis=0), right
    else:
        before = np.concatenate([right[:1], right])
        after = np.concatenate([right, right[-1:]])
    mitre = (before + after) / (1.0 + np.sum(before * after, axis=1, keepdims=True))
    frame = {"xy": np.eye(3), "zx": np.eye(3)[[2, 0, 1]]}[plane]

    parts = []
    for k, side in enumerate(right):
        ends = (k, (k + 1) % len(line))
        run = float(np.linalg.norm(line[ends[1]] - line[ends[0]]))
        rows = []
        for end in ends:
            flat = line[end] + points[:, :1] * mitre[end]
            rows.append(np.concatenate([flat, points[:, 1:]], axis=1))
        normal = np.concatenate([normals[:, :1] * side, normals[:, 1:]], axis=1)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        uv = np.concatenate([np.stack(np.broadcast_arrays(u, length), axis=1) for u in (0.0, run)])
        count = len(points)
        faces = np.array(
            [[[i, count + i + 1, i + 1], [i, count + i, count + i + 1]] for i in starts]
        ).reshape(-1, 3)
        parts.append(
            Geometry(np.concatenate(rows) @ frame, np.tile(normal, (2, 1)) @ frame, uv, faces)
        )
    return merge(parts)


def quad(corner: ArrayLike, u: ArrayLike, v: ArrayLike) -> Geometry:
    """Parallelogram ``corner + s u + t v`` facing u x v, with texture coordinates (s, t)."""
    o, a, b = (np.asarray(value, dtype=np.float64) for value in (corner, u, v))
    normal = np.broadcast_to(normalize(np.cross(a, b)), (4, 3))
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return Geometry(
        np.array([o, o + a, o + a + b, o + b]), normal, uv, np.array([[0, 1, 2], [0, 2, 3]])
    )
