"""The guide: a distribution of directions for every cell of space, to look up, sample and evaluate.

A cell's distribution is piecewise constant over equal areas of the sphere (bins of cos theta and
phi), mixed with a uniform share. Its bins are the leaves of a binary tree of sums, so that a draw
takes one look-up a level. A share of a cell's directions still comes from the BSDF.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..sampling.streams import Stream, uniform2
from .cells import CELLS

Z_BITS, PHI_BITS = 4, 4
LEVELS = Z_BITS + PHI_BITS

DEEP, DEEP_ALPHA = 3, 0.7
"""From this vertex on at least this share comes from the BSDF: a path's factors multiply."""

COSTS = 6
"""Numbers of a cell by which its share is chosen."""

UNIFORM = 0.1
"""Share of a cell's distribution that is spread evenly over the sphere."""


@dataclass
class Guide:
    """What is known of where light comes from.

    Fields: ``sums`` (see :mod:`mitsuba_restir.guiding.trees`), ``alpha`` (of every cell:
    the share of directions that come from the BSDF; 1 where nothing has been seen), ``costs`` and
    ``mean`` (what only the learning needs: see :mod:`mitsuba_restir.guiding.share`, and the mean
    luminance that the last frame learnt from).
    """

    sums: list[mi.Float]
    alpha: mi.Float
    costs: mi.Float
    mean: mi.Float


def no_guide() -> Guide:
    """A guide that has seen nothing."""
    guide = Guide(
        [dr.zeros(mi.Float, CELLS << level) for level in range(LEVELS + 1)],
        dr.full(mi.Float, 1, CELLS),
        dr.zeros(mi.Float, CELLS * COSTS),
        mi.Float(0),
    )
    dr.make_opaque(guide)
    return guide


def alpha_at(guide: Guide, cell: mi.UInt32, vertex: mi.UInt32 | int, active: mi.Bool) -> mi.Float:
    """Share of the directions that leave a path's vertex by its BSDF; 1 in inactive lanes."""
    alpha = dr.gather(mi.Float, guide.alpha, cell, active)
    alpha = dr.select(vertex < DEEP, alpha, dr.maximum(alpha, DEEP_ALPHA))
    return dr.select(active, alpha, 1)


def leaf_of(direction: mi.Vector3f) -> mi.UInt32:
    """The bin that a world-space direction falls into."""
    z = dr.clip(0.5 * direction.z + 0.5, 0, 1 - 2.0**-24)
    phi = dr.atan2(direction.y, direction.x) * dr.inv_two_pi
    phi = dr.minimum(phi - dr.floor(phi), 1 - 2.0**-24)
    row, column = mi.UInt32(z * (1 << Z_BITS)), mi.UInt32(phi * (1 << PHI_BITS))
    return (row << PHI_BITS) | column


def pdf(guide: Guide, cell: mi.UInt32, direction: mi.Vector3f, active: mi.Bool) -> mi.Float:
    """Density [1/sr] of a direction in a known cell."""
    leaf = dr.gather(mi.Float, guide.sums[-1], (cell << LEVELS) | leaf_of(direction), active)
    total = dr.gather(mi.Float, guide.sums[0], cell, active)
    share = dr.select(total > 0, leaf / total, 0)
    return ((1 - UNIFORM) * (1 << LEVELS) * share + UNIFORM) * dr.inv_four_pi


def sample(
    guide: Guide, cell: mi.UInt32, random: Stream, vertex: mi.UInt32, active: mi.Bool
) -> mi.Vector3f:
    """A direction of a known cell, by the blocks 0 and 1 of a vertex of a stream."""
    descent, spread = uniform2(random, vertex, 0)
    a, b = uniform2(random, vertex, 1)
    total = dr.gather(mi.Float, guide.sums[0], cell, active)
    rest, node = descent * total, mi.UInt32(cell)
    for level in guide.sums[1:]:
        left = dr.gather(mi.Float, level, 2 * node, active)
        right = rest >= left
        rest = dr.select(right, rest - left, rest)
        node = 2 * node + dr.select(right, mi.UInt32(1), 0)
    row = (node >> PHI_BITS) & ((1 << Z_BITS) - 1)
    column = node & ((1 << PHI_BITS) - 1)
    evenly = spread < UNIFORM
    z = dr.select(evenly, a, (mi.Float(row) + a) * 2.0**-Z_BITS)
    phi = dr.select(evenly, b, (mi.Float(column) + b) * 2.0**-PHI_BITS)
    z = 2 * z - 1
    radius = dr.sqrt(dr.maximum(1 - dr.square(z), 0))
    sin, cos = dr.sincos(dr.two_pi * phi)
    return mi.Vector3f(radius * cos, radius * sin, z)
