"""How shapes have moved since the previous frame: where a point of a surface was, and where it is.

Only rigid motion is followed: it keeps areas, so that a vertex that goes along with its shape needs
no Jacobian. Shapes that change in any other way lose their history.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from .packing import number_of, pack_facing
from .primary_hit import PrimaryHit
from .vertex import Stored


@dataclass
class Moves:
    """One entry for every number of a shape; without motion all of it is zero.

    Fields: ``axis``, ``angle`` (imaginary part of the unit quaternion that turns a shape from the
    previous frame to this one, and its real part), ``offset`` (added to what was turned), ``moved``
    (not 0 where the shape is elsewhere), ``lost`` (not 0 where its motion is not rigid), ``size``
    (how many entries there are).
    """

    axis: mi.Vector3f
    angle: mi.Float
    offset: mi.Vector3f
    moved: mi.UInt32
    lost: mi.UInt32
    size: mi.UInt32


@dataclass
class Move:
    """The motion of one surface per lane; fields as in :class:`Moves`."""

    axis: mi.Vector3f
    angle: mi.Float
    offset: mi.Vector3f
    moved: mi.Bool
    lost: mi.Bool

    def turned(self, v: mi.Vector3f) -> mi.Vector3f:
        """A direction of the previous frame, turned with the surface."""
        return _turned(v, self.axis, self.angle)

    def turned_back(self, v: mi.Vector3f) -> mi.Vector3f:
        """A direction of this frame, turned back to the previous one."""
        return _turned(v, -self.axis, self.angle)

    def forth(self, p: mi.Point3f) -> mi.Point3f:
        """Where a point of the surface is that was at ``p``."""
        return mi.Point3f(self.turned(mi.Vector3f(p)) + self.offset)

    def back(self, p: mi.Point3f) -> mi.Point3f:
        """Where the point of the surface was that is at ``p``."""
        return mi.Point3f(self.turned_back(mi.Vector3f(p) - self.offset))


def _turned(v: mi.Vector3f, axis: mi.Vector3f, angle: mi.Float) -> mi.Vector3f:
    # A quaternion of zeros turns nothing, and neither do masked lanes of a gather.
    return v + 2 * dr.cross(axis, dr.cross(axis, v) + angle * v)


def shape_number(vertex: Stored) -> mi.UInt32:
    """Number of the shape that places a vertex in the world: of an instanced one, the instance."""
    instance = number_of(vertex.instance)
    return dr.select(instance != 0, instance, number_of(vertex.shape))


def move_of(moves: Moves, vertex: Stored) -> Move:
    """How the surface of each vertex has moved."""
    number = shape_number(vertex)
    known = number < moves.size
    return Move(
        dr.gather(mi.Vector3f, moves.axis, number, known),
        dr.gather(mi.Float, moves.angle, number, known),
        dr.gather(mi.Vector3f, moves.offset, number, known),
        dr.gather(mi.UInt32, moves.moved, number, known) != 0,
        dr.gather(mi.UInt32, moves.lost, number, known) != 0,
    )


def hit_before(moves: Moves, hit: PrimaryHit) -> tuple[PrimaryHit, Move]:
    """What a primary hit was in the previous frame, seen as it is seen now, and how it moved."""
    move = move_of(moves, hit.vertex)
    before = replace(
        hit,
        vertex=replace(hit.vertex, p=move.back(hit.vertex.p)),
        start=move.back(hit.origin),
        facing=pack_facing(mi.Normal3f(move.turned_back(mi.Vector3f(hit.normal))), hit.footprint),
    )
    return before, move
