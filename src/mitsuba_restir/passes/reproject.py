"""Re-projection: where the surface that a pixel sees now was in the previous frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.camera import Camera, project
from ..paths.primary_hit import PrimaryHit
from .primary import Primary
from .reuse import similar


@dataclass
class Motion:
    """Where each pixel's surface was.

    Fields: ``pixel`` (``UInt32``, previous pixel, row-major), ``valid`` (``Bool``, it saw the same
    surface), ``flow`` (``Vector2f``, previous minus current film position [pixels]).
    """

    pixel: Any
    valid: Any
    flow: Any


def reproject(
    now: Primary, previous_hits: PrimaryHit, camera: Camera, size: tuple[Any, Any]
) -> Motion:
    """Follow every primary hit into the previous camera; disocclusion looks at the G-buffer only.

    The hit's own sub-pixel position decides which pixel it falls into, so that a static camera
    finds its own pixel again.
    """
    width, height = size
    uv, in_front = project(camera, now.hit.vertex.p, now.lens)
    inside = in_front & (uv.x >= 0) & (uv.y >= 0) & (uv.x < 1) & (uv.y < 1)
    x = dr.minimum(mi.UInt32(uv.x * width), width - 1)
    y = dr.minimum(mi.UInt32(uv.y * height), height - 1)
    pixel = dr.select(inside, y * width + x, 0)
    before = dr.gather(PrimaryHit, previous_hits, pixel, inside)
    return Motion(
        pixel,
        inside & similar(now.hit, before),
        (mi.Vector2f(uv) - mi.Vector2f(now.film)) * mi.Vector2f(width, height),
    )
