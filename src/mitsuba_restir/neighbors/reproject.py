"""The neighbour in time: where the surface that a pixel sees now was in the previous frame."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.camera import Camera, project
from ..paths.grid import Grid
from ..paths.moves import Moves, hit_before
from ..paths.primary_hit import Primary, PrimaryHit
from .similarity import similar


@dataclass
class Motion:
    """Where each pixel's surface was.

    Fields: ``pixel`` (previous pixel), ``valid`` (it saw the same surface), ``flow``
    (previous minus current film position [pixels]), ``moved`` (the surface itself has moved),
    ``lost`` (by a motion that is not followed).
    """

    pixel: mi.UInt32
    valid: mi.Bool
    flow: mi.Vector2f
    moved: mi.Bool
    lost: mi.Bool


def nowhere(grid: Grid) -> Motion:
    """The motion of pixels without a history."""
    no = dr.zeros(mi.Bool, grid.size)
    return Motion(dr.zeros(mi.UInt32, grid.size), no, mi.Vector2f(0), no, no)


def reproject(
    grid: Grid, now: Primary, previous_hits: PrimaryHit, camera: Camera, moves: Moves | None
) -> Motion:
    """Follow every primary hit into the previous camera; disocclusion looks at the G-buffer only.

    The hit's own sub-pixel position decides which pixel it falls into, so that a static camera
    finds its own pixel again.

    Parameters
    ----------
    moves : Moves or None
        How the surfaces have moved; None where they stand still.
    """
    then, moved, lost = now.hit, mi.Bool(False), mi.Bool(False)
    if moves is not None:
        then, move = hit_before(moves, now.hit)
        moved, lost = move.moved, move.lost
    uv, in_front = project(camera, then.vertex.p, now.lens)
    inside = in_front & (uv.x >= 0) & (uv.y >= 0) & (uv.x < 1) & (uv.y < 1)
    x = dr.minimum(mi.UInt32(uv.x * grid.width), grid.width - 1)
    y = dr.minimum(mi.UInt32(uv.y * grid.height), grid.height - 1)
    pixel = dr.select(inside, grid.index(x, y), 0)
    before = previous_hits.at(pixel, inside)
    return Motion(
        pixel,
        inside & similar(then, before) & ~lost,
        (mi.Vector2f(uv) - mi.Vector2f(now.film)) * mi.Vector2f(grid.width, grid.height),
        moved,
        lost,
    )
