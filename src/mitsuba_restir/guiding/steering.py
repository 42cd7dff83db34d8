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
from .guide import Guide, cell_at, known, pdf, sample


@dataclass
class Ledger:
    """Factors of a growing path's candidates.

    Fields: ``settled`` (of all bounces but the last), ``stored`` and ``replayed`` (r and s of the
    last one).
    """

    settled: mi.Float
    stored: mi.Float
    replayed: mi.Float

    def factor(self, stored: mi.Bool) -> mi.Float:
        """Of all bounces; ``stored``: whether the last one's direction is."""
        return self.settled * dr.select(stored, self.stored, self.replayed)

    def inverse(self, stored: mi.Bool) -> mi.Float:
        """What the weight of a candidate that ends here is multiplied with; 0 where it is none."""
        factor = self.factor(stored)
        return dr.select(factor > 0, 1 / factor, 0)

    def after(self, stored: mi.Bool, bounce: Ledger) -> Ledger:
        """After one more bounce, which is open, while the one before has been settled."""
        return Ledger(self.factor(stored), bounce.stored, bounce.replayed)


def empty_ledger() -> Ledger:
    """Of a path without bounces."""
    return Ledger(mi.Float(1), mi.Float(1), mi.Float(1))


def share_of_bsdf(
    guide: Guide, cell: mi.UInt32, bsdf: mi.BSDFPtr, alpha: float, active: mi.Bool
) -> mi.Float:
    """Probability with which a direction comes from the BSDF: 1 where the guide is of no use.

    Parameters
    ----------
    cell : UInt32
        See :func:`mitsuba_restir.guiding.guide.cell_at`.
    alpha : float
        Of cells that have seen light.
    active : Bool
        Lanes where the guide may be used at all.
    """
    # Of a surface that can be passed through, the BSDF's sample tells how much it covers.
    usable = active & can_connect(bsdf) & ~mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)
    usable &= known(guide, cell, usable)
    return dr.select(usable, mi.Float(alpha), 1)


class Steering(Protocol):
    """Where the directions of candidates come from."""

    def bounce(
        self,
        si: mi.SurfaceInteraction3f,
        stream: Stream,
        choices: Stream,
        vertex: mi.UInt32,
        active: mi.Bool,
        anchored: mi.Bool,
    ) -> tuple[Scattered, Ledger]:
        """The bounce from a vertex and its own factors.

        Parameters
        ----------
        stream, choices : Stream
            The path's, with which the BSDF is sampled, and the pass's.
        anchored : Bool
            Lanes whose reconnection vertex comes before this vertex.
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
        anchored: mi.Bool,
    ) -> tuple[Scattered, Ledger]:
        """See :class:`Steering`."""
        return scatter(si, si.bsdf(), stream, vertex, active), empty_ledger()


@dataclass(frozen=True)
class ByGuide:
    """Directions come from the BSDF with probability ``alpha``, else from the ``guide``.

    ``suffixes``: whether those after the one that leaves x_k may, too.
    """

    guide: Guide
    alpha: float
    suffixes: bool

    def bounce(
        self,
        si: mi.SurfaceInteraction3f,
        stream: Stream,
        choices: Stream,
        vertex: mi.UInt32,
        active: mi.Bool,
        anchored: mi.Bool,
    ) -> tuple[Scattered, Ledger]:
        """See :class:`Steering`."""
        guide, bsdf = self.guide, si.bsdf()
        steer = choices.fork(0)
        choice, _ = uniform2(steer, vertex, 2)
        cell = cell_at(guide, si.p, si.n)
        steerable = active if self.suffixes else active & ~anchored
        alpha = share_of_bsdf(guide, cell, bsdf, self.alpha, steerable)
        usable = alpha < 1

        bounce = scatter(si, bsdf, stream, vertex, active)
        leaves = usable & (choice >= alpha)
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
        g = pdf(guide, cell, chosen.wo, usable)
        ratio = dr.select(chosen.pdf > 0, g / chosen.pdf, 0)
        stored = dr.select(chosen.delta, alpha, alpha + (1 - alpha) * ratio)
        replayed = dr.select(leaves, 0, alpha)
        return chosen, Ledger(mi.Float(1), stored, replayed)
