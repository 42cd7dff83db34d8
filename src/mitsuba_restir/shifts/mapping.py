"""The choice of shift mapping as data, and the outcomes that a shift can have."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..sampling.codes import Codes
from .connectability import Criterion, Departure, Link


class Outcome(Codes):
    """What became of a shift."""

    OK = 0
    EMPTY = 1  # nothing to shift
    TERMINATED = 2  # the replayed prefix ended early
    INVERTIBILITY = 3  # the shifted path has an earlier reconnection vertex
    UNCONNECTABLE = 4  # the new pair fails the connectability test
    DARK = 5  # the shifted integrand vanishes (a BSDF or an emitter faces away)
    OCCLUDED = 6  # the new connection is blocked
    NOT_FINITE = 7  # the shifted integrand or its weight is not finite


MERGE_REFUSED = 1 << 6
"""Bit beside the packed outcomes of a pass: single precision cannot hold the merged weight, and the
pixel keeps its own sample."""


@dataclass(frozen=True)
class ShiftMapping:
    """A shift mapping.

    Attributes
    ----------
    criterion : Criterion
        The connectability test.
    last_index : int or None
        Largest index of a reconnection vertex (None: any), which makes the pure reconnection shift
        (2) and pure random replay (0) special cases of the hybrid shift.
    replays : bool
        Whether a prefix may be replayed. Without it only paths that need none can be shifted.
    hides_sky : bool
        Whether the environment gives no light to paths that have not scattered on their way to it,
        but only passed through null lobes.
    """

    criterion: Criterion
    last_index: int | None
    replays: bool
    hides_sky: bool = False

    def link(
        self,
        start: Departure,
        ray: mi.Ray3f,
        si: mi.SurfaceInteraction3f,
        end_limit: mi.Float,
        index: mi.UInt32,
        footprint: mi.Float,
    ) -> Link:
        """Test the pair that ends at ``si``, the path's ``index``-th vertex.

        Parameters
        ----------
        start : Departure
            How the path left x_{k-1}.
        ray : Ray3f
            The ray that found ``si``. It starts off the surface of x_{k-1}; a solid angle there is
            an area at x_k by the distance from that point.
        end_limit : Float
            The criterion's ``vertex_limit`` at ``si``.
        footprint : Float
            The pixel's :func:`.connectability.pixel_footprint`.
        """
        valid = si.is_valid()
        span = si.p - ray.o
        distance2 = dr.squared_norm(span)
        cos_end = dr.abs(dr.dot(si.n, span)) * dr.rsqrt(distance2)
        rough = ~start.delta & (start.pdf <= start.limit) & (start.pdf > 0)
        if self.last_index is not None:
            rough &= index <= self.last_index
        area_pdf = start.pdf * dr.select(valid, cos_end / distance2, 1.0)
        far = ~valid | self.criterion.is_far(distance2, start, cos_end, footprint)
        reaches = rough & far & (area_pdf > 0)
        limit = self.criterion.leaving_limit(distance2, start, footprint, end_limit)
        return Link(reaches, dr.select(reaches & valid, limit, -1.0), area_pdf)


def shift_mapping(name: str, criterion: Criterion) -> ShiftMapping:
    """The mapping called ``name``: ``hybrid``, ``reconnection`` or ``random_replay``."""
    return {
        "hybrid": ShiftMapping(criterion, None, True),
        "reconnection": ShiftMapping(criterion, 2, False),
        "random_replay": ShiftMapping(criterion, 0, True),
    }[name]
