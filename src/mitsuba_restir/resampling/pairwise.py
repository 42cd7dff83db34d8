"""Pairwise merging: each pixel with similar neighbours, by defensive pairwise MIS.

Lin et al. 2022 (GRIS), section 7.1 and supplement. With canonical sample x, V similar neighbours
x_i out of k requested ones, and confidences c, neighbour i and the canonical sample are paired by

    m_i(y)  = c_i p_i(T^-1 y) |J^-1| / (c_i p_i(T^-1 y) |J^-1| + (c/k) p(y)),   m_i + m_{c,i} = 1,

and the pixel is the plain mean of the V + 1 estimators that the pairs and the canonical sample are:

    g_0 = F(x) W,     g_i = m_i F(y_i) W_i J_i + m_{c,i} F(x) W.

Each has the expectation of the pixel; where neighbours go by rank, their mean has. Their luminance
sums to that of the selected sample, so shading by the mean of the g (vector weights) changes colour
noise only.

The two halves of a pair are two shifts: the neighbour's path to the pixel, for y_i, and the
pixel's path to the neighbour, for m_{c,i}. Who is whose neighbour, and how few shifts that takes,
is decided in :mod:`mitsuba_restir.neighbors`.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.record import PathRecord, with_factor
from ..paths.spectrum import target
from ..sampling.streams import Stream, uniform
from ..shifts.hybrid import shift
from ..shifts.mapping import Outcome
from ..shifts.scope import Scope
from . import mis
from .mis import density, share
from .reservoir import Reservoir, is_sound


@dataclass
class Sharing:
    """The pixels that share paths.

    Fields: ``scope``, ``hits`` (of all pixels), ``neighbors`` (k).
    """

    scope: Scope
    hits: PrimaryHit
    neighbors: int


@dataclass
class Pulled:
    """The path of one neighbour of every pixel, shifted to the pixel.

    Fields: ``source`` (the neighbour), ``valid`` (there is one that is reused),
    ``color`` (F of the shifted path here), ``factor`` (its own p G p), ``weight`` (m_i W_i J_i:
    what F counts with), ``reach`` (c p J: the density with which this pixel makes the neighbour's
    path, for the neighbour's MIS weight; 0 where the neighbour does not weigh its sample against
    this pixel), ``outcome`` (of the shift).
    """

    source: mi.UInt32
    valid: mi.Bool
    color: mi.Color3f
    factor: mi.Float
    weight: mi.Float
    reach: mi.Float
    outcome: mi.UInt8


@dataclass
class PairEstimators:
    """The k + 1 estimators of every pixel's colour whose mean spatial reuse shows.

    Fields: ``colors`` (g_0 = F(x) W, then the g_i of the neighbours), ``valid`` (the pixel has that
    estimator; g_0 everywhere).
    """

    colors: list[mi.Color3f]
    valid: list[mi.Bool]


def pull(
    sharing: Sharing,
    reservoirs: Reservoir,
    source: mi.UInt32,
    valid: mi.Bool,
    returned: mi.Bool,
) -> Pulled:
    """Shift the path of one neighbour to every pixel.

    Paths are pulled rather than pushed: the lanes of a packet then start from adjacent pixels.

    Parameters
    ----------
    reservoirs : Reservoir
        All pixels' reservoirs.
    source : UInt32
        Every pixel's neighbour.
    valid : Bool
        Whether the pixel reuses the neighbour's path.
    returned : Bool
        Whether the neighbour weighs its sample against this pixel.
    """
    theirs = dr.gather(Reservoir, reservoirs, source, valid | returned)
    wanted = (valid | returned) & (theirs.weight > 0)
    shifted = shift(sharing.scope, theirs.path, sharing.hits, wanted)
    m_other = share(
        density(theirs.confidence, target(theirs.color), 1 / shifted.jacobian),
        reservoirs.confidence / sharing.neighbors * target(shifted.color),
    )
    weight = m_other * shifted.jacobian * theirs.weight
    used = valid & (target(shifted.color) > 0)
    refused = used & ~dr.isfinite(weight * target(shifted.color))
    reach = density(reservoirs.confidence, target(shifted.color), shifted.jacobian)
    return Pulled(
        source,
        valid,
        shifted.color,
        shifted.factor,
        dr.select(used & ~refused, weight, 0),
        dr.select(returned, reach, 0),
        mi.UInt8(dr.select(refused, Outcome.NOT_FINITE, shifted.outcome)),
    )


def push(
    sharing: Sharing, reservoirs: Reservoir, there: mi.UInt32, valid: mi.Bool
) -> tuple[mi.Float, mi.UInt8]:
    """Shift every pixel's own path to a neighbour.

    Parameters
    ----------
    there : UInt32
        The neighbour.
    valid : Bool
        Whether there is one to reuse.

    Returns
    -------
    reach : Float
        c p J: the density with which the neighbour makes the pixel's path.
    outcome : UInt8
        Of the shift.
    """
    hit = sharing.hits.at(there, valid)
    confidence = dr.gather(mi.Float, reservoirs.confidence, there, valid)
    wanted = valid & (reservoirs.weight > 0)
    shifted = shift(sharing.scope, reservoirs.path, hit, wanted)
    return density(confidence, target(shifted.color), shifted.jacobian), mi.UInt8(shifted.outcome)


def canonical_share(sharing: Sharing, reservoirs: Reservoir, reach: mi.Float) -> mi.Float:
    """MIS weight m_{c,i} of every pixel's own sample against the neighbour that has the reach."""
    own = reservoirs.confidence / sharing.neighbors * target(reservoirs.color)
    return mis.canonical_share(own, reach)


def merge(
    reservoirs: Reservoir,
    pulled: list[Pulled],
    shares: list[mi.Float],
    confidence: mi.Float,
    random: Stream,
) -> tuple[Reservoir, mi.Color3f, PairEstimators]:
    """Merge the neighbours' paths into every pixel's reservoir.

    Parameters
    ----------
    pulled : list of Pulled
        One entry per neighbour.
    shares : list of Float
        The canonical sample's weight in each pair, see :func:`canonical_share`; 0 where a pair is
        not valid.
    confidence : Float
        What the merged reservoirs hand on.
    random : Stream
        Of the selection, one stream per pixel.

    Returns
    -------
    reservoir : Reservoir
        The merged reservoirs; the pixel's own where single precision cannot hold the merged one.
    color : Color3f
        Mean of the pair estimators.
    estimators : PairEstimators
        One entry for the canonical sample and one per neighbour (none is valid where the merged
        reservoir is refused).
    """
    pixel = dr.arange(mi.UInt32, dr.width(reservoirs.weight))
    canonical = reservoirs.color * reservoirs.weight

    total = mi.Float(0)  # sum of resampling weights
    selected = mi.UInt32(pixel)  # pixel whose path leads
    selected_color = mi.Color3f(reservoirs.color)
    selected_factor = mi.Float(reservoirs.path.factor)
    color = mi.Color3f(0)  # sum of the neighbours' parts of the pair estimators g_i
    canonical_sum = mi.Float(1)  # sum of the canonical sample's pairwise weights
    count = mi.Float(1)  # V + 1
    estimators = PairEstimators([canonical], [mi.Bool(True)])

    for i, (theirs, pair_share) in enumerate(zip(pulled, shares, strict=True)):
        weight = theirs.weight * target(theirs.color)
        total += weight
        take = (weight > 0) & (uniform(random, i, 0) * total < weight)
        selected = dr.select(take, theirs.source, selected)
        selected_color = dr.select(take, theirs.color, selected_color)
        selected_factor = dr.select(take, theirs.factor, selected_factor)

        color += theirs.weight * theirs.color
        canonical_sum += pair_share
        estimators.colors.append(theirs.weight * theirs.color + pair_share * canonical)
        estimators.valid.append(theirs.valid)
        count += dr.select(theirs.valid, mi.Float(1), 0)

    weight = canonical_sum * target(canonical)
    total += weight
    keep = uniform(random, len(pulled), 0) * total < weight
    selected = dr.select(keep, pixel, selected)
    selected_color = dr.select(keep, reservoirs.color, selected_color)
    selected_factor = dr.select(keep, reservoirs.path.factor, selected_factor)

    leading = target(selected_color)
    weight = dr.select(leading > 0, total / (count * leading), 0)
    color = (color + canonical_sum * canonical) / count
    sound = is_sound(weight, total) & dr.all(dr.isfinite(color))
    path = dr.gather(PathRecord, reservoirs.path, dr.select(sound, selected, pixel))
    merged = Reservoir(
        with_factor(path, dr.select(sound, selected_factor, reservoirs.path.factor)),
        dr.select(sound, selected_color, reservoirs.color),
        dr.select(sound, weight, reservoirs.weight),
        confidence,
    )
    estimators.valid = [estimators.valid[0], *(valid & sound for valid in estimators.valid[1:])]
    return merged, dr.select(sound, color, canonical), estimators
