"""History that has lost its surfaces: paths over shapes whose primitives are not what they were.

A vertex is stored as a primitive of a shape. Where the shape has been given other primitives, the
number may be out of range, or another place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import drjit as dr
import mitsuba as mi

from ..sampling.absent import Absent
from .packing import number_of
from .primary_hit import PrimaryHit
from .record import Continuation, PathRecord
from .vertex import Stored, exists, no_vertex


def drop_reshaped(
    hits: PrimaryHit, path: PathRecord, reshaped: Sequence[mi.Shape], instanced: bool
) -> tuple[PrimaryHit, mi.Bool]:
    """Take the primary hit from every pixel whose stored vertices are no longer valid.

    Re-projection does not find a pixel without a primary hit, so all of its history is dropped. For
    one frame, which pixels keep their history depends on their paths; what they keep is of a scene
    that was edited anyway.

    Parameters
    ----------
    hits, path : PrimaryHit, PathRecord
        The history's primary hits and paths.
    reshaped : sequence of Shape
        Shapes with other primitives than before, at least one.
    instanced : bool
        Whether one of them is in a shape group. Which one an instance shows is not stored: all
        instanced vertices count as lost.

    Returns
    -------
    hits : PrimaryHit
    lost : Bool
        Pixels that had something to lose.
    """
    numbers = number_of(mi.ShapePtr(list(reshaped)))
    size = dr.opaque(mi.UInt32, int(dr.max(numbers)[0]) + 1)
    table = dr.zeros(mi.UInt32, int(size[0]))
    dr.scatter(table, mi.UInt32(1), numbers)
    dr.eval(table)
    instances_too = dr.opaque(mi.Bool, instanced)

    def gone(vertex: Stored) -> mi.Bool:
        number = number_of(vertex.shape)
        named = dr.gather(mi.UInt32, table, number, number < size) != 0
        return named | (instances_too & (vertex.instance != None))  # noqa: E711  (element-wise)

    lost = gone(hits.vertex) | gone(path.vertex)
    if isinstance(path.next, Continuation):
        lost |= gone(path.next.vertex)
    lost &= exists(hits.vertex)
    none = no_vertex(isinstance(hits.vertex.primitive, Absent))
    return replace(hits, vertex=dr.select(lost, none, hits.vertex)), lost
