"""The neighbour in time: where the surface that a pixel sees now was in the previous frame."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.camera import Camera, project
from ..paths.grid import Grid
from ..paths.primary_hit import Primary, PrimaryHit
from .similarity import similar


@dataclass
class Motion:
    """Where each pixel's surface was.

    Fields: ``pixel`` (previous pixel, row-major), ``valid`` (it saw the same surface), ``flow``
    (previous minus current film position [pixels]).
    """

    pixel: mi.UInt32
    valid: mi.Bool
    flow: mi.Vector2f


def reproject(grid: Grid, now: Primary, previous_hits: PrimaryHit, camera: Camera) -> Motion:
    """Follow every primary hit into the previous camera; disocclusion looks at the G-buffer only.

    The hit's own sub-pixel position decides which pixel it falls into, so that a static camera
    finds its own pixel again.
    """
    uv, in_front = project(camera, now.hit.vertex.p, now.lens)
    inside = in_front & (uv.x >= 0) & (uv.y >= 0) & (uv.x < 1) & (uv.y < 1)
    x = dr.minimum(mi.UInt32(uv.x * grid.width), grid.width - 1)
    y = dr.minimum(mi.UInt32(uv.y * grid.height), grid.height - 1)
    pixel = dr.select(inside, grid.index(x, y), 0)
    before = dr.gather(PrimaryHit, previous_hits, pixel, inside)
    return Motion(
        pixel,
        inside & similar(now.hit, before),
        (mi.Vector2f(uv) - mi.Vector2f(now.film)) * mi.Vector2f(grid.width, grid.height),
    )
