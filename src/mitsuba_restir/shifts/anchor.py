"""The reconnection vertex of a growing path, and the records of the paths that end on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.packing import keep_radiance, pack_direction
from ..paths.record import Continuation, Form, Kind, PathRecord, pack_info, rounding
from ..paths.scattering import LightSample, Scattered, balance
from ..paths.vertex import Spot, Stored, nowhere
from ..sampling.absent import Absent
from ..sampling.streams import PathName, Stream
from .connectability import Departure, Link


@dataclass
class Follower:
    """The vertex after the reconnection vertex.

    Fields: ``vertex`` (x_{k+1}), ``wo`` (direction leaving it), ``delta`` (by a delta lobe),
    ``suffix`` (throughput of the bounces after x_{k+1}'s own).
    """

    vertex: Stored
    wo: mi.Vector3f
    delta: mi.Bool
    suffix: mi.Spectrum


@dataclass
class Anchor:
    """The reconnection vertex that a growing path has found, if ``k`` is not 0.

    Fields: ``k``, ``vertex`` (x_k), ``wo`` (direction leaving it), ``factor`` (p_{k-1} G p_k),
    ``suffix`` (throughput of the bounces after x_k's own), ``next`` (:class:`Absent` where records
    need no continuation).
    """

    k: mi.UInt32
    vertex: Stored
    wo: mi.Vector3f
    factor: mi.Float
    suffix: mi.Spectrum
    next: Follower | Absent


@dataclass
class Place:
    """Where a growing path is.

    Fields: ``name`` (of the path), ``stream`` (its numbers), ``anchor`` (as found before),
    ``arrival`` (the pair that ends here), ``vertex`` (x_j), ``index`` (j).
    """

    name: PathName
    stream: Stream
    anchor: Anchor
    arrival: Link
    vertex: Stored
    index: mi.UInt32


def no_anchor(form: Form) -> Anchor:
    """The anchor of a path without a reconnection vertex."""
    none = nowhere(form.compact)
    nothing = Follower(none, dr.zeros(mi.Vector3f), mi.Bool(False), mi.Spectrum(1))
    return Anchor(
        mi.UInt32(0),
        none,
        dr.zeros(mi.Vector3f),
        mi.Float(1),
        mi.Spectrum(1),
        nothing if form.continued else Absent(),
    )


def onward(place: Place, bounce: Scattered) -> Anchor:
    """The anchor after one more bounce, from x_j."""
    anchor, here, j = place.anchor, place.vertex, place.index
    free = ~bounce.delta & (bounce.pdf <= place.arrival.limit)
    found = Anchor(
        j, here, bounce.wo, place.arrival.area_pdf * bounce.pdf, mi.Spectrum(1), anchor.next
    )
    anchored = anchor.k != 0
    follower = anchor.next
    if isinstance(follower, Follower):
        follower = dr.select(
            anchored & (anchor.k + 1 == j),
            Follower(here, bounce.wo, bounce.delta, mi.Spectrum(1)),
            replace(follower, suffix=follower.suffix * bounce.weight),
        )
    suffix = dr.select(anchored, anchor.suffix * bounce.weight, 1)
    return dr.select((anchor.k == 0) & free, found, replace(anchor, suffix=suffix, next=follower))


@dataclass
class Ahead:
    """What a continuation is to hold: ``vertex`` x_{k+1}, ``wo`` leaving it, ``radiance`` there."""

    vertex: Stored
    wo: mi.Vector3f
    radiance: mi.Spectrum


@dataclass
class Kept:
    """What a record keeps of the light: ``arriving``, ``next``, and the ``share`` that is left."""

    arriving: Any
    next: Continuation | Absent
    share: mi.Spectrum


def _kept(
    stream: Stream,
    info: mi.UInt32,
    radiance: mi.Spectrum,
    ahead: Ahead | Absent,
    light_pdf: mi.Float,
) -> Kept:
    """Radiance as records keep it, and what is left of it: the path's integrand is that times it.

    Where the light goes on from x_{k+1} to x_k, what arrives here follows from what is kept there.
    """
    following: Continuation | Absent = Absent()
    share, kind = mi.Spectrum(1), info & 7
    if isinstance(ahead, Ahead):
        there, left = keep_radiance(ahead.radiance, rounding(stream, info, True))
        share = dr.select(kind == Kind.FAR, left, share)
        following = Continuation(ahead.vertex, pack_direction(ahead.wo), there, light_pdf)
    arriving, left = keep_radiance(radiance * share, rounding(stream, info, False))
    used = (kind >= Kind.FAR) & (kind != Kind.LIGHT)
    return Kept(arriving, following, dr.select(used, share * left, 1))


def record_hit(
    place: Place,
    start: Departure,
    direction: mi.Vector3f,
    radiance: mi.Spectrum,
    light_pdf: mi.Float,
    on_surface: mi.Bool,
) -> tuple[PathRecord, mi.Spectrum]:
    """Record of the path whose last bounce found the light at x_j; with what is :func:`_kept`.

    Parameters
    ----------
    start : Departure
        How the path left x_{j-1}.
    direction : Vector3f
        From x_{j-1} to the light.
    radiance, light_pdf : Spectrum, Float
        What it emits, and the density of sampling it from x_{j-1} [1/sr].
    on_surface : Bool
        Whether x_j exists; otherwise the light is the environment.
    """
    anchor, arrival, here, j = place.anchor, place.arrival, place.vertex, place.index
    anchored, none = anchor.k != 0, nowhere(isinstance(here, Spot))
    from_anchor = anchored & (anchor.k + 1 == j)
    to_light = ~anchored & arrival.reaches
    mis = balance(start.pdf, light_pdf)
    kind = dr.select(
        anchored,
        dr.select(from_anchor, mi.UInt32(Kind.HIT), Kind.FAR),
        dr.select(
            arrival.reaches,
            dr.select(on_surface, mi.UInt32(Kind.LIGHT), Kind.ENVIRONMENT),
            Kind.REPLAY_HIT,
        ),
    )
    next_kind = mi.UInt32(Kind.EMPTY)
    ahead: Ahead | Absent = Absent()
    if isinstance(anchor.next, Follower):
        second = anchor.k + 2 == j
        found = dr.select(second, mi.UInt32(Kind.HIT), Kind.FAR)
        next_kind = dr.select(anchored & ~from_anchor & ~anchor.next.delta, found, next_kind)
        ahead = Ahead(
            dr.select(from_anchor, dr.select(on_surface, here, none), anchor.next.vertex),
            anchor.next.wo,
            dr.select(second, radiance, anchor.next.suffix * radiance * mis),
        )
    info = pack_info(
        kind, False, dr.select(anchored, anchor.k, dr.select(to_light, j, 0)), j, next_kind
    )
    arriving = dr.select(anchored & ~from_anchor, anchor.suffix * radiance * mis, radiance)
    kept = _kept(place.stream, info, arriving, ahead, light_pdf)
    return PathRecord(
        place.name,
        info,
        dr.select(anchored, anchor.vertex, dr.select(to_light & on_surface, here, none)),
        pack_direction(dr.select(anchored, anchor.wo, direction)),
        kept.arriving,
        light_pdf,
        dr.select(anchored, anchor.factor, dr.select(to_light, arrival.area_pdf, 1)),
        kept.next,
    ), kept.share


def record_nee(
    place: Place,
    light: LightSample,
    numbers: mi.Point2f,
    pdf: mi.Float,
    scattered: mi.Spectrum,
    light_pdf: mi.Float,
) -> tuple[PathRecord, mi.Spectrum]:
    """Record of the path that ends in a light sampled from x_j; with what is :func:`_kept`.

    Parameters
    ----------
    numbers : Point2f
        With which the light was sampled.
    pdf : Float
        Density with which the BSDF at x_j would have found the light [1/sr].
    scattered : Spectrum
        BSDF times cosine at x_j, times the MIS weight.
    light_pdf : Float
        Density of the light sample [1/sr]; 0 where only that technique can find the light.
    """
    anchor, arrival, here, j = place.anchor, place.arrival, place.vertex, place.index
    anchored, none = anchor.k != 0, nowhere(isinstance(here, Spot))
    from_here = ~anchored & (pdf <= arrival.limit)
    kind = dr.select(
        anchored,
        mi.UInt32(Kind.FAR),
        dr.select(from_here, mi.UInt32(Kind.NEE), Kind.REPLAY_NEE),
    )
    next_kind = mi.UInt32(Kind.EMPTY)
    ahead: Ahead | Absent = Absent()
    if isinstance(anchor.next, Follower):
        second = anchor.k + 1 == j
        next_kind = dr.select(
            second,
            mi.UInt32(Kind.NEE),
            dr.select(anchor.next.delta, mi.UInt32(Kind.EMPTY), Kind.FAR),
        )
        next_kind = dr.select(anchored, next_kind, Kind.EMPTY)
        ahead = Ahead(
            dr.select(second, here, anchor.next.vertex),
            dr.select(second, light.d, anchor.next.wo),
            dr.select(second, light.weight, anchor.next.suffix * scattered * light.weight),
        )
    # A light sampled before any reconnection vertex is described by the numbers that sampled it.
    leaving = pack_direction(dr.select(anchored, anchor.wo, light.d))
    info = pack_info(
        kind, True, dr.select(anchored, anchor.k, dr.select(from_here, j, 0)), j + 1, next_kind
    )
    arriving = dr.select(anchored, anchor.suffix * scattered * light.weight, light.weight)
    kept = _kept(place.stream, info, arriving, ahead, light_pdf)
    return PathRecord(
        place.name,
        info,
        dr.select(anchored, anchor.vertex, dr.select(from_here, here, none)),
        dr.select(anchored | from_here, leaving, numbers),
        kept.arriving,
        light_pdf,
        dr.select(anchored, anchor.factor, dr.select(from_here, arrival.area_pdf, 1)),
        kept.next,
    ), kept.share
