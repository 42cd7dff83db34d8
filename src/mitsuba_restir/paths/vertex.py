"""Surface vertices, from which the interaction is rebuilt without a ray.

There are those of primary hits, whose points are looked at often, and those of records. In compact
scenes (:func:`.packing.fits_compact`) both need fewer bytes; all others have them as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import drjit as dr
import mitsuba as mi

from ..sampling.absent import Absent
from .packing import ON_MESH, pack_compact, pack_surface, unpack_compact, unpack_surface


@dataclass
class Vertex:
    """A surface point as (position, surface coordinates, primitive), one per lane.

    Fields: ``p`` (world), ``uv`` (coordinates in the primitive), ``surface`` and ``primitive`` (the
    words of :func:`.packing.pack_surface`, or the one of :func:`.packing.pack_compact`). A vertex
    on no surface is nowhere.
    """

    p: mi.Point3f
    uv: mi.Point2f
    surface: mi.UInt32
    primitive: mi.UInt32 | Absent

    @property
    def place(self) -> mi.Point3f:
        """What is stored of where it is."""
        return self.p

    @property
    def shape(self) -> mi.ShapePtr:
        """The shape that it is on; null for one of an instance, unless the backend names it."""
        return self.found(mi.Float(0)).shape

    @property
    def instance(self) -> mi.ShapePtr:
        """The instance that its shape is seen through; null without."""
        return self.found(mi.Float(0)).instance

    def found(self, distance: mi.Float) -> mi.PreliminaryIntersection3f:
        """The intersection of a ray that has found it at a distance."""
        pi = _nothing_found(distance, exists(self))
        pi.prim_uv = self.uv
        if isinstance(self.primitive, Absent):
            pi.shape, pi.prim_index = unpack_compact(self.surface)
        else:
            pi.shape, pi.instance, pi.shape_index, pi.prim_index = unpack_surface(
                self.surface, self.primitive
            )
        return pi


@dataclass
class Spot:
    """A surface point of a compact scene's records (16 bytes), one per lane.

    Fields: ``place`` (coordinates in the primitive on a mesh, which alone say where that is;
    elsewhere the position), ``surface`` (its word, with :data:`.packing.ON_MESH`).
    """

    place: mi.Point3f
    surface: mi.UInt32

    @property
    def shape(self) -> mi.ShapePtr:
        """The shape that it is on."""
        return unpack_compact(self.surface)[0]

    @property
    def instance(self) -> mi.ShapePtr:
        """No instance."""
        return dr.zeros(mi.ShapePtr)

    @property
    def on_mesh(self) -> mi.Bool:
        """Lanes whose point follows from the mesh as it is."""
        return (self.surface & ON_MESH) != 0

    def found(self, distance: mi.Float) -> mi.PreliminaryIntersection3f:
        """The intersection of a ray that has found it at a distance."""
        pi = _nothing_found(distance, exists(self))
        pi.prim_uv = mi.Point2f(self.place.x, self.place.y)
        pi.shape, pi.prim_index = unpack_compact(self.surface)
        return pi


Stored: TypeAlias = Vertex | Spot
"""A vertex of a record."""


@dataclass
class Sight:
    """A vertex as it is seen from somewhere.

    Fields: ``ray`` (that would have found it), ``si`` (what it would have found), ``p`` (the point
    that it aims at).
    """

    ray: mi.Ray3f
    si: mi.SurfaceInteraction3f
    p: mi.Point3f


def _nothing_found(distance: mi.Float, valid: mi.Bool) -> mi.PreliminaryIntersection3f:
    pi = dr.zeros(mi.PreliminaryIntersection3f)
    pi.t, pi.valid = distance, valid
    return pi


def compact(pi: mi.PreliminaryIntersection3f, p: mi.Point3f, small: bool) -> Vertex:
    """Compact form of an intersection ``pi`` whose surface point is ``p``.

    Parameters
    ----------
    small : bool
        Whether the scene is a compact one.
    """
    words = (pack_compact(pi), Absent()) if small else pack_surface(pi)
    return Vertex(mi.Point3f(p), mi.Point2f(pi.prim_uv), *words)


def stored(pi: mi.PreliminaryIntersection3f, p: mi.Point3f, small: bool) -> Stored:
    """The same as a record's vertex."""
    vertex = compact(pi, p, small)
    if not small:
        return vertex
    on_mesh = mi.ShapePtr(pi.shape).is_mesh()
    place = dr.select(on_mesh, mi.Point3f(vertex.uv.x, vertex.uv.y, 0), vertex.p)
    return Spot(place, vertex.surface | dr.select(on_mesh, mi.UInt32(ON_MESH), 0))


def no_vertex(small: bool) -> Vertex:
    """A vertex that is nowhere."""
    primitive = Absent() if small else mi.UInt32(0)
    return Vertex(dr.zeros(mi.Point3f), dr.zeros(mi.Point2f), mi.UInt32(0), primitive)


def nowhere(small: bool) -> Stored:
    """The same as a record's vertex."""
    return Spot(dr.zeros(mi.Point3f), mi.UInt32(0)) if small else no_vertex(False)


def exists(vertex: Stored) -> mi.Bool:
    """Lanes whose vertex is on a surface."""
    return vertex.surface != 0


def displaced(vertex: Stored, motion: Callable[[mi.Point3f], mi.Point3f]) -> Stored:
    """The vertex where a motion takes it; what is on a mesh is where the mesh is."""
    if isinstance(vertex, Vertex):
        return replace(vertex, p=motion(vertex.p))
    return replace(vertex, place=dr.select(vertex.on_mesh, vertex.place, motion(vertex.place)))


def ray_to(p: mi.Point3f, origin: mi.Point3f, lambdas: mi.Spectrum) -> tuple[mi.Ray3f, mi.Float]:
    """The ray from a point to another one, and their distance."""
    span = p - origin
    distance = dr.norm(span)
    return mi.Ray3f(origin, span / distance, 0.0, lambdas), distance


def seen_from(
    vertex: Vertex, origin: mi.Point3f, lambdas: mi.Spectrum
) -> tuple[mi.Ray3f, mi.PreliminaryIntersection3f]:
    """The ray from ``origin`` to the vertex and the intersection that it would have found."""
    ray, distance = ray_to(vertex.p, origin, lambdas)
    return ray, vertex.found(distance)


def sight(
    vertex: Stored,
    start: Callable[[mi.Point3f], mi.Point3f],
    lambdas: mi.Spectrum,
    active: mi.Bool,
) -> Sight:
    """A record's vertex as it is seen from where a ray to it starts.

    Parameters
    ----------
    start : callable
        (point of the vertex) -> where the ray starts.
    """
    ray, distance = ray_to(vertex.place, start(vertex.place), lambdas)
    si = vertex.found(distance).compute_surface_interaction(ray, active=active)
    if isinstance(vertex, Vertex):
        return Sight(ray, si, vertex.p)
    # A mesh does not ask from where it is seen: that can be known afterwards.
    p = dr.select(vertex.on_mesh, si.p, vertex.place)
    ray, distance = ray_to(p, start(p), lambdas)
    si.wi = dr.select(vertex.on_mesh, si.to_local(-ray.d), si.wi)
    si.t = dr.select(vertex.on_mesh & si.is_valid(), distance, si.t)
    return Sight(ray, si, p)


def connection(si: mi.SurfaceInteraction3f, p: mi.Point3f) -> tuple[mi.Ray3f, mi.Float, mi.Bool]:
    """The ray with which a bounce from ``si`` would have found a point.

    A traced ray starts off its surface, on the side to which it leaves, and by an offset that is
    not small where a scene is small or far from the origin. Direction, distance and visibility are
    those of that ray, so that a path shifted to its own pixel has a Jacobian of one.

    Returns
    -------
    ray : Ray3f
    distance : Float
    found : Bool
        Whether there is such a bounce: none finds what lies within the offset of the tangent plane.
    """
    ray, distance = ray_to(p, _start(si, p), si.wavelengths)
    return ray, distance, _leads(si, ray, p)


def connected(
    si: mi.SurfaceInteraction3f, vertex: Stored, active: mi.Bool
) -> tuple[Sight, mi.Bool]:
    """A record's vertex as a bounce from ``si`` finds it; whether one does (:func:`connection`)."""
    seen = sight(vertex, lambda p: _start(si, p), si.wavelengths, active)
    return seen, _leads(si, seen.ray, seen.p)


def _start(si: mi.SurfaceInteraction3f, p: mi.Point3f) -> mi.Point3f:
    return si.spawn_ray_to(p).o


def _leads(si: mi.SurfaceInteraction3f, ray: mi.Ray3f, p: mi.Point3f) -> mi.Bool:
    return dr.dot(si.n, ray.d) * dr.dot(si.n, p - si.p) > 0
