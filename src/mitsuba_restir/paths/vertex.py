"""Compact surface vertices: 28 bytes from which the interaction is rebuilt without a ray."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .packing import pack_surface, unpack_surface


@dataclass
class Vertex:
    """A surface point as (position, surface coordinates, primitive), one per lane.

    Fields: ``p`` (world), ``uv`` (coordinates in the primitive), ``surface`` and ``primitive`` (the
    words of :func:`.packing.pack_surface`). A vertex on no surface is nowhere.
    """

    p: mi.Point3f
    uv: mi.Point2f
    surface: mi.UInt32
    primitive: mi.UInt32

    @property
    def shape(self) -> mi.ShapePtr:
        """The shape that it is on; null for one of an instance, unless the backend names it."""
        return unpack_surface(self.surface, self.primitive)[0]

    @property
    def instance(self) -> mi.ShapePtr:
        """The instance that its shape is seen through; null without."""
        return unpack_surface(self.surface, self.primitive)[1]


def compact(pi: mi.PreliminaryIntersection3f, p: mi.Point3f) -> Vertex:
    """Compact form of an intersection ``pi`` whose surface point is ``p``."""
    return Vertex(mi.Point3f(p), mi.Point2f(pi.prim_uv), *pack_surface(pi))


def no_vertex() -> Vertex:
    """A vertex that is nowhere."""
    return Vertex(dr.zeros(mi.Point3f), dr.zeros(mi.Point2f), mi.UInt32(0), mi.UInt32(0))


def exists(vertex: Vertex) -> mi.Bool:
    """Lanes whose vertex is on a surface."""
    return vertex.surface != 0


def seen_from(
    vertex: Vertex, origin: mi.Point3f, lambdas: mi.Spectrum
) -> tuple[mi.Ray3f, mi.PreliminaryIntersection3f]:
    """The ray from ``origin`` to the vertex and the intersection that it would have found."""
    to_vertex = vertex.p - origin
    distance = dr.norm(to_vertex)
    ray = mi.Ray3f(origin, to_vertex / distance, 0.0, lambdas)
    pi = dr.zeros(mi.PreliminaryIntersection3f)
    pi.t = distance
    pi.prim_uv = vertex.uv
    pi.shape, pi.instance, pi.shape_index, pi.prim_index = unpack_surface(
        vertex.surface, vertex.primitive
    )
    pi.valid = exists(vertex)
    return ray, pi


def connected(
    si: mi.SurfaceInteraction3f, vertex: Vertex
) -> tuple[mi.Ray3f, mi.PreliminaryIntersection3f, mi.Bool]:
    """The ray with which a bounce from ``si`` would have found the vertex, and what it found.

    A traced ray starts off its surface, on the side to which it leaves, and by an offset that is
    not small where a scene is small or far from the origin. Direction, distance and visibility are
    those of that ray, so that a path shifted to its own pixel has a Jacobian of one.

    Returns
    -------
    ray : Ray3f
    pi : PreliminaryIntersection3f
    found : Bool
        Whether there is such a bounce: none finds what lies within the offset of the tangent plane.
    """
    ray, pi = seen_from(vertex, si.spawn_ray_to(vertex.p).o, si.wavelengths)
    return ray, pi, dr.dot(si.n, ray.d) * dr.dot(si.n, vertex.p - si.p) > 0
