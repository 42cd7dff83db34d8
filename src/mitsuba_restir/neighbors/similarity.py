"""Which surfaces are alike: the G-buffer test of two pixels that would share paths."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.vertex import exists

NORMAL_COSINE = 0.5
"""Smallest cosine between the shading normals of two pixels that share paths."""

DEPTH_RATIO = 0.1
"""Largest distance of one hit from the other's tangent plane, relative to its camera distance."""


def similar(hit: PrimaryHit, other: PrimaryHit) -> mi.Bool:
    """Whether two primary hits may share paths, by normal and depth alone.

    Depth is compared across the tangent plane, so that a surface seen at a grazing angle is similar
    to itself.
    """
    span = other.vertex.p - hit.vertex.p
    depth = dr.norm(hit.vertex.p - hit.origin)
    return (
        exists(hit.vertex)
        & exists(other.vertex)
        & (dr.dot(hit.normal, other.normal) >= NORMAL_COSINE)
        & (dr.abs(dr.dot(hit.normal, span)) <= DEPTH_RATIO * depth)
    )
