"""The primary hit x_1 of a pixel: what a shift needs of its destination, and what history keeps."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .vertex import Vertex, no_vertex, seen_from


@dataclass
class PrimaryHit:
    """G-buffer entry (56 bytes a pixel).

    Fields: ``vertex`` (x_1; null shape where the camera ray escapes), ``origin`` (x_0, the lens
    point), ``normal`` (shading normal), ``footprint`` (the pixel's footprint at x_1, see
    :func:`mitsuba_restir.shifts.connectability.pixel_footprint`).
    """

    vertex: Vertex
    origin: mi.Point3f
    normal: mi.Normal3f
    footprint: mi.Float


@dataclass
class Primary:
    """What the camera sees directly.

    Fields: ``hit``, ``emitted`` (light seen directly), ``backdrop`` (alpha of what is behind all
    surfaces: 1 where the sky is shown), ``film`` (film position in the crop window's unit square),
    ``lens`` (lens sample).
    """

    hit: PrimaryHit
    emitted: mi.Color3f
    backdrop: mi.Float
    film: mi.Point2f
    lens: mi.Point2f


def no_primary_hit() -> PrimaryHit:
    """A primary hit that hits nothing."""
    return PrimaryHit(no_vertex(), dr.zeros(mi.Point3f), dr.zeros(mi.Normal3f), mi.Float(0))


def camera_ray(
    hit: PrimaryHit, lambdas: mi.Spectrum
) -> tuple[mi.Ray3f, mi.PreliminaryIntersection3f]:
    """The ray x_0 -> x_1 and its intersection, rebuilt without tracing."""
    return seen_from(hit.vertex, hit.origin, lambdas)
