"""The primary hit x_1 of a pixel: what a shift needs of its destination, and what history keeps."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .camera import Eye
from .packing import unpack_footprint, unpack_normal
from .vertex import Vertex, no_vertex, seen_from


@dataclass
class PrimaryHit:
    """G-buffer entry: 28 bytes a pixel in compact scenes, 32 in others.

    Where camera rays have no common origin it has 12 more.

    Fields: ``vertex`` (x_1; on no surface where the camera ray escapes), ``facing`` (the word of
    :func:`.packing.pack_facing`), ``start`` (where rays come from: one for all, or each its own).
    """

    vertex: Vertex
    facing: mi.UInt32
    start: Eye | mi.Point3f

    @property
    def origin(self) -> mi.Point3f:
        """The point x_0 where the camera ray starts."""
        start = self.start
        return start.origin(self.vertex.p) if isinstance(start, Eye) else start

    @property
    def normal(self) -> mi.Normal3f:
        """Shading normal, as exact as deciding what may be shared asks for."""
        return unpack_normal(self.facing)

    @property
    def footprint(self) -> mi.Float:
        """Footprint at x_1, :func:`mitsuba_restir.shifts.connectability.pixel_footprint`."""
        return unpack_footprint(self.facing)

    def at(self, pixel: mi.UInt32, active: mi.Bool | bool = True) -> PrimaryHit:
        """Those of other pixels, of all of which these are."""
        start = self.start
        if not isinstance(start, Eye):
            start = dr.gather(mi.Point3f, start, pixel, active)
        vertex = dr.gather(Vertex, self.vertex, pixel, active)
        return PrimaryHit(vertex, dr.gather(mi.UInt32, self.facing, pixel, active), start)


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


def no_primary_hits(pixels: int, eye: Eye | None, small: bool) -> PrimaryHit:
    """Primary hits that hit nothing, of rays from one eye if there is one.

    Parameters
    ----------
    small : bool
        Whether the scene is a compact one.
    """
    start = dr.zeros(mi.Point3f, pixels) if eye is None else eye
    nothing = dr.full(mi.UInt32, 0, pixels)
    return PrimaryHit(dr.gather(Vertex, no_vertex(small), nothing), nothing, start)


def camera_ray(
    hit: PrimaryHit, lambdas: mi.Spectrum
) -> tuple[mi.Ray3f, mi.PreliminaryIntersection3f]:
    """The ray x_0 -> x_1 and its intersection, rebuilt without tracing."""
    return seen_from(hit.vertex, hit.origin, lambdas)
