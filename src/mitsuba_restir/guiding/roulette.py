"""Russian roulette: which paths go on, and with what probability.

A candidate's weight is divided by the probability that its path got so far, which depends on the
path and on earlier frames alone. By throughput, as in Mitsuba's ``path``, or by contribution: with
what is known of the radiance that leaves every cell of space, a path is expected to contribute w L
(w: what a candidate that ends here counts with; L: of its last vertex's cell), the pixel the L of
its primary hit. Adjoint-driven roulette (Vorba and Krivanek 2016) survives with their ratio; the
square root of it weighs variance against time (Rath et al. 2022) and was the better one here.

The radiances are learnt step by step: a vertex is worth the light sampled from it, and what the
next one is worth by what is known so far (temporal differences, Dahm and Keller 2017).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import drjit as dr
import mitsuba as mi

from .cells import CELLS, UNIT, Cells, cell_at

LEAST = 0.1
"""Smallest probability to go on."""

LARGEST = 0.95
"""Largest one where nothing is known, or by throughput: no path goes on for ever."""

MOST = 2.0**40
"""Largest number that is counted at once."""

REMEMBERED = 0.9
"""What the past counts with from frame to frame."""


@dataclass
class Outlook:
    """What a growing path may look forward to.

    Fields: ``cell`` (of the last vertex), ``step`` (luminance of the weight of the bounce from it,
    over the probability to go on), ``here`` and ``own`` (what the cells of the last vertex and of
    x_1 are expected to be worth).
    """

    cell: mi.UInt32
    step: mi.Float
    here: mi.Float
    own: mi.Float


def no_outlook() -> Outlook:
    """Of a path that has not begun."""
    return Outlook(mi.UInt32(0), mi.Float(0), mi.Float(0), mi.Float(0))


@dataclass
class Leaving:
    """How a path leaves a vertex.

    Fields: ``vertex`` (its index), ``sampled`` (luminance that leaves it of the light sampled from
    it), ``worth`` (what a luminance of one that leaves it counts with in a candidate's weight),
    ``step`` (luminance of the weight of the bounce), ``brightest`` (channel of the throughput after
    the bounce, over the survival so far), ``eta`` (index of refraction relative to the camera).
    """

    vertex: mi.UInt32
    sampled: mi.Float
    worth: mi.Float
    step: mi.Float
    brightest: mi.Float
    eta: mi.Float


class Roulette(Protocol):
    """Decides which paths go on."""

    def arrive(
        self,
        outlook: Outlook,
        si: mi.SurfaceInteraction3f,
        vertex: mi.UInt32,
        found: mi.Float,
        active: mi.Bool,
    ) -> Outlook:
        """The outlook from the next vertex, where the bounce has ``found`` a luminance."""

    def leave(
        self, outlook: Outlook, leaving: Leaving, active: mi.Bool
    ) -> tuple[mi.Float, Outlook]:
        """The probability to go on, and the outlook of what does."""


@dataclass(frozen=True)
class ByThroughput:
    """As in Mitsuba's ``path``, from the vertex ``depth`` on."""

    depth: int

    def arrive(
        self,
        outlook: Outlook,
        si: mi.SurfaceInteraction3f,
        vertex: mi.UInt32,
        found: mi.Float,
        active: mi.Bool,
    ) -> Outlook:
        """See :class:`Roulette`."""
        return outlook

    def leave(
        self, outlook: Outlook, leaving: Leaving, active: mi.Bool
    ) -> tuple[mi.Float, Outlook]:
        """See :class:`Roulette`."""
        chance = dr.minimum(leaving.brightest * dr.square(leaving.eta), LARGEST)
        return dr.select(leaving.vertex >= self.depth, chance, 1), outlook


@dataclass
class Expected:
    """What is known of the light that leaves the cells.

    Fields: ``sums`` (a cell's luminance and visits), ``radiance`` (their ratio),
    ``unit`` (of luminance, in which a frame is counted: :data:`.cells.UNIT` times the mean of the
    candidates, first times 1).
    """

    sums: mi.Float
    radiance: mi.Float
    unit: mi.Float


def nothing_expected() -> Expected:
    """Before the first frame."""
    tables = dr.zeros(mi.Float, 2 * CELLS), dr.zeros(mi.Float, CELLS)
    expected = Expected(*tables, mi.Float(UNIT))
    dr.make_opaque(expected)
    return expected


def nothing_noted() -> mi.UInt64:
    """A frame's notes: a cell's luminance and visits."""
    return dr.opaque(mi.UInt64, 0, 2 * CELLS)


def updated(expected: Expected, notes: mi.UInt64, candidates: mi.Float, memory: float) -> Expected:
    """With a frame's notes.

    Parameters
    ----------
    candidates : Float
        Luminances of the frame's candidates, one lane per pixel.
    memory : float
        What the past counts with; 1 where nothing moves.
    """
    entry, cell = dr.arange(mi.UInt32, 2 * CELLS), dr.arange(mi.UInt32, CELLS)
    unit = dr.select(entry & 1 == 0, expected.unit, 1)
    sums = expected.sums * (REMEMBERED * memory) + mi.Float(notes) * unit
    dr.eval(sums)
    total, visits = (dr.gather(mi.Float, sums, 2 * cell + i) for i in range(2))
    radiance = dr.select(visits > 0, total / visits, 0)
    mean = dr.mean(candidates)
    unit = dr.select(mean > 0, mean * UNIT, expected.unit)
    return replace(expected, sums=sums, radiance=radiance, unit=unit)


@dataclass(frozen=True)
class ByContribution:
    """By what paths are expected to contribute; ``notes`` are taken of what they find.

    ``cells``: where the cells are.
    """

    cells: Cells
    expected: Expected
    notes: mi.UInt64

    def arrive(
        self,
        outlook: Outlook,
        si: mi.SurfaceInteraction3f,
        vertex: mi.UInt32,
        found: mi.Float,
        active: mi.Bool,
    ) -> Outlook:
        """See :class:`Roulette`."""
        surface = active & si.is_valid()
        cell = cell_at(self.cells, si.p, si.n)
        here = dr.gather(mi.Float, self.expected.radiance, cell, surface)
        self._note(outlook.step * (found + here), outlook.cell, active & (vertex > 1))
        return Outlook(cell, mi.Float(0), here, dr.select(vertex == 1, here, outlook.own))

    def leave(
        self, outlook: Outlook, leaving: Leaving, active: mi.Bool
    ) -> tuple[mi.Float, Outlook]:
        """See :class:`Roulette`."""
        self._note(leaving.sampled, outlook.cell, active)
        dr.scatter_add(self.notes, mi.UInt64(1), 2 * outlook.cell + 1, active)
        ratio = leaving.worth * outlook.here / outlook.own
        known = (outlook.here > 0) & (outlook.own > 0)
        chance = dr.select(known, dr.clip(dr.sqrt(ratio), LEAST, 1), LARGEST)
        chance = dr.select(leaving.vertex == 1, 1, chance)
        return chance, replace(outlook, step=leaving.step / chance)

    def _note(self, value: mi.Float, cell: mi.UInt32, active: mi.Bool) -> None:
        number = mi.UInt64(dr.minimum(value / self.expected.unit, MOST) + 0.5)
        dr.scatter_add(self.notes, number, 2 * cell, active & (value > 0))
