"""Neighbours picked by a score of the G-buffer (compatibility-guided neighbour selection, CGNS).

Junkins et al. 2026: candidates y on a disk around x are scored by

    h = exp(-|x - y| / s) max(n_x . n_y, 0)^beta,    s = sqrt(Omega / pi) |x - camera|,

and picked by weighted reservoir sampling. Every pick is reused without bias, so the choice may
favour whom it likes, as long as it does not look at the paths.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.vertex import exists
from ..resampling.pairwise import Sharing, canonical_share, pull, push
from ..resampling.reservoir import Reservoir
from ..sampling.streams import Stream, uniform, uniform2
from .exchange import Exchange
from .similarity import similar

CANDIDATES = 32
"""Candidates of a pixel, shared out among its neighbours."""

SOLID_ANGLE = 0.05
"""Omega [sr], which sets the length over which compatibility fades."""

NORMAL_EXPONENT = 8
"""beta."""


@dataclass
class Disk:
    """Where candidates come from: a disk of ``radius`` pixels."""

    radius: mi.Float


def disk(radius: float) -> Disk:
    """The disk of a radius [pixels]."""
    return Disk(mi.Float(radius))


def scored(sharing: Sharing, disk: Disk, reservoirs: Reservoir, choices: Stream) -> Exchange:
    """Reuse picks with good scores of the G-buffer."""
    pulled, shares, outcomes = [], [], []
    confidence = mi.Float(reservoirs.confidence)
    for j in range(sharing.neighbors):
        other, found = pick(sharing, disk, dr.opaque(mi.UInt32, j), choices)
        there = sharing.hits.at(other, found)
        valid = found & similar(sharing.hits, there)
        theirs = pull(sharing, reservoirs, other, valid, mi.Bool(False))
        dr.eval(theirs)
        reach, outcome = push(sharing, reservoirs, other, valid)
        own = dr.select(valid, canonical_share(sharing, reservoirs, reach), 0)
        confidence += dr.gather(mi.Float, reservoirs.confidence, other, valid)
        dr.eval(own, outcome, confidence)
        pulled.append(theirs)
        shares.append(own)
        outcomes += [theirs.outcome, outcome]
    return Exchange(pulled, shares, confidence, outcomes)


@dr.syntax
def pick(
    sharing: Sharing, disk: Disk, index: mi.UInt32, choices: Stream
) -> tuple[mi.UInt32, mi.Bool]:
    """Pick every pixel's ``index``-th neighbour among its share of the candidates.

    Parameters
    ----------
    choices : Stream
        Of the round.

    Returns
    -------
    other : UInt32
        Index of the neighbour (the pixel itself where there is none).
    found : Bool
        Whether there is one.
    """
    grid, hits = sharing.scope.grid, sharing.hits
    pixel = grid.pixels()
    random = choices.fork(index).fork(pixel)
    reach = dr.norm(hits.vertex.p - hits.origin) * (SOLID_ANGLE / dr.pi) ** 0.5
    other = mi.UInt32(pixel)
    total = mi.Float(0)
    share = -(-CANDIDATES // sharing.neighbors)
    i = mi.UInt32(0)

    while dr.hint(i < share, exclude=[sharing, grid, disk], label="Scores"):
        u, angle = uniform2(random, i, 0)
        sin, cos = dr.sincos(dr.two_pi * angle)
        length = disk.radius * dr.sqrt(u)
        dx, dy = mi.Int32(dr.round(length * cos)), mi.Int32(dr.round(length * sin))
        candidate, _ = grid.look(pixel, dx, dy)
        there = hits.at(candidate)
        distance = dr.norm(there.vertex.p - hits.vertex.p)
        alike = dr.maximum(dr.dot(there.normal, hits.normal), 0) ** NORMAL_EXPONENT
        score = dr.exp(-distance / reach) * alike
        score = dr.select((candidate != pixel) & exists(there.vertex), score, 0)
        total += score
        take = (score > 0) & (uniform(random, i, 1) * total < score)
        other = dr.select(take, candidate, other)
        i += 1
    return other, exists(hits.vertex) & (total > 0)
