"""Compact surface vertices: 36 bytes from which the interaction is rebuilt without a ray."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi


@dataclass
class Vertex:
    """A surface point as (position, shape, primitive, surface coordinates), one per lane.

    Fields: ``p`` (world), ``uv`` (coordinates in the primitive), ``prim`` and ``index`` (of the
    primitive and the shape), ``shape`` and ``instance``.
    A vertex without shape and instance is nowhere.
    """

    p: mi.Point3f
    uv: mi.Point2f
    prim: mi.UInt32
    index: mi.UInt32
    shape: mi.ShapePtr
    instance: mi.ShapePtr


def compact(pi: mi.PreliminaryIntersection3f, p: mi.Point3f) -> Vertex:
    """Compact form of an intersection ``pi`` whose surface point is ``p``."""
    return Vertex(
        mi.Point3f(p),
        mi.Point2f(pi.prim_uv),
        mi.UInt32(pi.prim_index),
        mi.UInt32(pi.shape_index),
        mi.ShapePtr(pi.shape),
        mi.ShapePtr(pi.instance),
    )


def no_vertex() -> Vertex:
    """A vertex that is nowhere."""
    return Vertex(
        dr.zeros(mi.Point3f),
        dr.zeros(mi.Point2f),
        mi.UInt32(0),
        mi.UInt32(0),
        dr.zeros(mi.ShapePtr),
        dr.zeros(mi.ShapePtr),
    )


def exists(vertex: Vertex) -> mi.Bool:
    """Lanes whose vertex is on a surface (``Bool``); an instanced one has only an instance."""
    return (vertex.shape != None) | (vertex.instance != None)  # noqa: E711  (element-wise)


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
    pi.prim_index = vertex.prim
    pi.shape_index = vertex.index
    pi.shape = vertex.shape
    pi.instance = vertex.instance
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
