"""Which surfaces are alike: the G-buffer test of two pixels that would share paths."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.vertex import exists

NORMAL_COSINE = 0.5
"""Smallest cosine between the shading normals of two pixels that share paths."""

DEPTH_RATIO = 0.1
"""Largest distance of one hit from the other's tangent plane, relative to its camera distance."""


@dataclass
class Surface:
    """What a pixel sees, as far as similarity asks.

    Fields: ``place``, ``normal`` (shading normal), ``depth`` (distance from the camera; below zero
    where there is no surface).
    """

    place: mi.Point3f
    normal: mi.Normal3f
    depth: mi.Float


def surface_of(hit: PrimaryHit) -> Surface:
    """What a primary hit is on."""
    place = hit.vertex.p
    depth = dr.select(exists(hit.vertex), dr.norm(place - hit.origin), -1)
    return Surface(place, hit.normal, depth)


def alike(own: Surface, other: Surface) -> mi.Bool:
    """Whether two pixels may share paths, by normal and depth alone.

    Depth is compared across the tangent plane, so that a surface seen at a grazing angle is similar
    to itself.
    """
    span = other.place - own.place
    return (
        (own.depth >= 0)
        & (other.depth >= 0)
        & (dr.dot(own.normal, other.normal) >= NORMAL_COSINE)
        & (dr.abs(dr.dot(own.normal, span)) <= DEPTH_RATIO * own.depth)
    )


def similar(hit: PrimaryHit, other: PrimaryHit) -> mi.Bool:
    """Whether two primary hits may share paths, see :func:`alike`."""
    return alike(surface_of(hit), surface_of(other))
