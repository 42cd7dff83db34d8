"""Steering: how fresh candidates choose their bounces, and what that is worth in their weights.

The measure stays that of the BSDF: F = f/p, whatever chose the direction. With probability alpha a
bounce is drawn from the BSDF, else from the guide's density g, and a candidate's resampling weight
is divided by one factor for each of its bounces:

    r = alpha + (1 - alpha) g / p    where the direction is stored: the bounce that reaches the
                                     reconnection vertex x_k, the one that leaves it, all later ones
    s = alpha                        where it is replayed: every earlier one, which then must have
                                     been drawn from the BSDF: a guided one leads to no candidate

A delta lobe is drawn with alpha and never from the guide. Which factor is a path's depends on the
path alone, since its k does: this is a one-sample mixture of techniques, unbiased for every guide
that does not depend on the frame's own samples. Whether a bounce is stored is known one vertex
later.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import drjit as dr
import mitsuba as mi

from ..paths.scattering import Scattered, can_connect, evaluate, scatter
from ..sampling.streams import Stream, uniform2
from .cells import Cells, cell_at
from .guide import Guide, alpha_at, pdf, sample


@dataclass
class Ledger:
    """Factors of a growing path's candidates.

    Fields: ``settled`` (of all bounces but the last), ``stored`` and ``replayed`` (r and s of the
    last one), ``anchored`` (whether the reconnection vertex comes before the last vertex).
    """

    settled: mi.Float
    stored: mi.Float
    replayed: mi.Float
    anchored: mi.Bool

    def factor(self, stored: mi.Bool) -> mi.Float:
        """Of all bounces; ``stored``: whether the last one's direction is."""
        return self.settled * dr.select(stored, self.stored, self.replayed)

    def inverse(self, stored: mi.Bool) -> mi.Float:
        """What the weight of a candidate that ends here is multiplied with; 0 where it is none."""
        factor = self.factor(stored)
        return dr.select(factor > 0, 1 / factor, 0)

    def after(self, stored: mi.Bool, bounce: Ledger) -> Ledger:
        """After one more bounce, which is open, while the one before has been settled."""
        return Ledger(self.factor(stored), bounce.stored, bounce.replayed, stored)


def empty_ledger() -> Ledger:
    """Of a path without bounces."""
    return Ledger(mi.Float(1), mi.Float(1), mi.Float(1), mi.Bool(False))


def steerable(bsdf: mi.BSDFPtr) -> mi.Bool:
    """Lanes whose directions may come from a guide.

    Of a surface that can be passed through, the BSDF's sample tells how much it covers.
    """
    return can_connect(bsdf) & ~mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)


class Steering(Protocol):
    """Where the directions of candidates come from."""

    def bounce(
        self,
        si: mi.SurfaceInteraction3f,
        stream: Stream,
        choices: Stream,
        vertex: mi.UInt32,
        active: mi.Bool,
        ledger: Ledger,
    ) -> tuple[Scattered, Ledger]:
        """The bounce from a vertex and its own factors.

        Parameters
        ----------
        stream, choices : Stream
            The path's, with which the BSDF is sampled, and the pass's.
        ledger : Ledger
            Of the path up to this vertex.
        """


@dataclass(frozen=True)
class ByBsdf:
    """All directions come from the BSDF."""

    def bounce(
        self,
        si: mi.SurfaceInteraction3f,
        stream: Stream,
        choices: Stream,
        vertex: mi.UInt32,
        active: mi.Bool,
        ledger: Ledger,
    ) -> tuple[Scattered, Ledger]:
        """See :class:`Steering`."""
        return scatter(si, si.bsdf(), stream, vertex, active), empty_ledger()


@dataclass(frozen=True)
class ByGuide:
    """Directions come from the BSDF with the probability that the guide says, else from the guide.

    ``cells``: where the guide's cells are. ``suffixes``: whether those after the one that leaves
    x_k may come from it, too.
    """

    cells: Cells
    guide: Guide
    suffixes: bool

    def bounce(
        self,
        si: mi.SurfaceInteraction3f,
        stream: Stream,
        choices: Stream,
        vertex: mi.UInt32,
        active: mi.Bool,
        ledger: Ledger,
    ) -> tuple[Scattered, Ledger]:
        """See :class:`Steering`."""
        guide, bsdf = self.guide, si.bsdf()
        steer = choices.fork(0)
        choice, _ = uniform2(steer, vertex, 2)
        cell = cell_at(self.cells, si.p, si.n)
        usable = active & steerable(bsdf)
        if not self.suffixes:
            usable &= ~ledger.anchored
        alpha = alpha_at(guide, cell, vertex, usable)

        bounce = scatter(si, bsdf, stream, vertex, active)
        leaves = choice >= alpha
        direction = sample(guide, cell, steer, vertex, leaves)
        value, density = evaluate(si, bsdf, direction, leaves)
        chosen = replace(
            bounce,
            wo=dr.select(leaves, direction, bounce.wo),
            weight=dr.select(
                leaves, dr.select(density > 0, value / density, mi.Spectrum(0)), bounce.weight
            ),
            pdf=dr.select(leaves, density, bounce.pdf),
            delta=bounce.delta & ~leaves,
            eta=dr.select(leaves, 1, bounce.eta),
        )
        g = pdf(guide, cell, chosen.wo, alpha < 1)
        ratio = dr.select(chosen.pdf > 0, g / chosen.pdf, 0)
        stored = dr.select(chosen.delta, alpha, alpha + (1 - alpha) * ratio)
        replayed = dr.select(leaves, 0, alpha)
        return chosen, Ledger(mi.Float(1), stored, replayed, mi.Bool(False))
