"""Triangle geometry as plain arrays: the data type, its transforms, and profile curves.

Units are metres, the y axis points up, and triangles are counter-clockwise seen from outside.
Nothing here needs Mitsuba, so the shapes are the same in every variant.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Faces = NDArray[np.int64]


@dataclass(frozen=True)
class Geometry:
    """
    A triangle mesh with shading normals and texture coordinates.

    Fields
    ------
    positions : (N, 3) vertex positions [m]
    normals : (N, 3) unit vertex normals
    uv : (N, 2) texture coordinates
    faces : (M, 3) vertex indices
    """

    positions: Array
    normals: Array
    uv: Array
    faces: Faces

    def move(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Geometry:
        """Translate by (x, y, z) [m]."""
        return replace(self, positions=self.positions + np.array([x, y, z]))

    def rotate(self, axis: str, degrees: float) -> Geometry:
        """Rotate about the coordinate axis ``'x'``, ``'y'`` or ``'z'`` through the origin."""
        first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
        c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
        matrix = np.eye(3)
        matrix[[first, first, second, second], [first, second, first, second]] = [c, -s, s, c]
        return replace(self, positions=self.positions @ matrix.T, normals=self.normals @ matrix.T)

    def scale_uv(self, u: float, v: float) -> Geometry:
        """Multiply the texture coordinates."""
        return replace(self, uv=self.uv * np.array([u, v]))

    def move_uv(self, u: float, v: float) -> Geometry:
        """Shift the texture coordinates, so that equal parts show different texture."""
        return replace(self, uv=self.uv + np.array([u, v]))


def merge(parts: Iterable[Geometry]) -> Geometry:
    """Join meshes into one; vertices are kept apart."""
    parts = list(parts)
    offsets = np.cumsum([0] + [len(part.positions) for part in parts[:-1]])
    return Geometry(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.uv for part in parts]),
        np.concatenate([part.faces + o for part, o in zip(parts, offsets, strict=True)]),
    )


def normalize(vectors: Array) -> Array:
    """Scale (..., k) vectors to unit length; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0, length, 1.0))


def grid_faces(rows: int, columns: int) -> Faces:
    """Triangles of a (rows, columns) vertex grid stored row by row; (M, 3)."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, 1:].ravel(), index[1:, :-1].ravel()
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def drop_degenerate(geometry: Geometry) -> Geometry:
    """Remove triangles without area (at the poles of a lathe, for example)."""
    a, b, c = (geometry.positions[geometry.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return replace(geometry, faces=geometry.faces[area > 1e-12])


def spline(points: ArrayLike, steps: int = 6) -> Array:
    """
    Catmull-Rom curve through (K, d) points, ``steps`` samples per span, ends included.

    The end tangents come from mirrored phantom points.
    """
    p = np.asarray(points, dtype=np.float64)
    p = np.concatenate([[2 * p[0] - p[1]], p, [2 * p[-1] - p[-2]]])
    t = (np.arange(steps) / steps)[:, None]
    spans = []
    for k in range(1, len(p) - 2):
        p0, p1, p2, p3 = p[k - 1 : k + 3]
        spans.append(
            0.5
            * (
                2 * p1
                + (p2 - p0) * t
                + (2 * p0 - 5 * p1 + 4 * p2 - p3) * t**2
                + (3 * p1 - p0 - 3 * p2 + p3) * t**3
            )
        )
    return np.concatenate([*spans, p[-2:-1]])


def fillet(points: Sequence[Sequence[float]], steps: int = 3) -> Array:
    """
    Round the corners of a planar polyline.

    Parameters
    ----------
    points : rows (x, y) or (x, y, radius); the radius is that of the arc replacing the corner,
        zero where it is not given. The first and the last point stay.
    steps : number of chords per arc

    Returns
    -------
    (K, 2) points
    """
    corner = np.array([[p[0], p[1]] for p in points])
    radius = [p[2] if len(p) > 2 else 0.0 for p in points]
    out = [corner[:1]]
    for k in range(1, len(corner) - 1):
        back, ahead = normalize(corner[k - 1] - corner[k]), normalize(corner[k + 1] - corner[k])
        half = 0.5 * np.arccos(np.clip(back @ ahead, -1.0, 1.0))
        if radius[k] == 0.0 or half > 0.5 * np.pi - 1e-6:
            out.append(corner[k : k + 1])
            continue
        centre = corner[k] + normalize(back + ahead) * radius[k] / np.sin(half)
        start = corner[k] + back * radius[k] / np.tan(half) - centre
        end = corner[k] + ahead * radius[k] / np.tan(half) - centre
        t = np.linspace(0.0, 1.0, steps + 1)[:, None]
        sweep = np.pi - 2 * half
        arc = (np.sin((1 - t) * sweep) * start + np.sin(t * sweep) * end) / np.sin(sweep)
        out.append(centre + arc)
    out.append(corner[-1:])
    return np.concatenate(out)


def profile_strip(profile: ArrayLike, crease: float = 40.0) -> tuple[Array, Array, list[int]]:
    """
    Normals of a planar profile curve, with its sharp corners split.

    Parameters
    ----------
    profile : (K, 2) points; the outside lies to the right of the direction of travel
    crease : corners that turn by more than this stay sharp [degrees]

    Returns
    -------
    points (L, 2), unit normals (L, 2), and the indices i for which (i, i + 1) is a segment
    """
    p = np.asarray(profile, dtype=np.float64)
    d = normalize(np.diff(p, axis=0))
    segment_normal = np.stack([d[:, 1], -d[:, 0]], axis=1)
    points, normals, segments = [p[0]], [segment_normal[0]], [0]
    for k in range(1, len(p) - 1):
        if d[k - 1] @ d[k] < np.cos(np.deg2rad(crease)):
            points += [p[k], p[k]]
            normals += [segment_normal[k - 1], segment_normal[k]]
        else:
            points.append(p[k])
            normals.append(normalize(segment_normal[k - 1] + segment_normal[k]))
        segments.append(len(points) - 1)
    points.append(p[-1])
    normals.append(segment_normal[-1])
    return np.array(points), np.array(normals), segments
