"""Blue-noise mutations: an acceptance rule that prefers paths unlike those of the neighbours.

A measured negative result, and biased. The rule (Fickel, *Blue Noise Distributed MCMC
Decorrelation of ReSTIR*) is simulated annealing at a low temperature T (Kirkpatrick et al. 1983) of
the energy e of a pixel among its neighbours (Georgiev and Fajardo 2016), blended into the
Metropolis-Hastings rule with a weight w:

    a(x -> y) = (a_bn w + C(y) / C(x) (1 - w)) T(y -> x) / T(x -> y),
    a_bn = 1 if e(y) < e(x), else exp(-(e(y) - e(x)) / T).

The energy of a path y compares the value lum(F(y)) W, W being the weight that the pixel had before
the first mutation. Were it the weight that y gets, lum(F(y)) W(y) would be what the pixel shows
anyway, e(y) = e(x), and the rule would do nothing: no mutation changes the luminance of its pixel.
So the rule arranges values that are never shown. And it leaves detailed balance with respect to the
target function, on which the update of W relies: whatever reuses the paths is biased unless w = 0.
Paths with next to no light are unlike their neighbours too, and leave with weights without bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..neighbors.around import spaced_pixels
from ..paths.grid import Grid
from ..paths.primary_hit import PrimaryHit
from ..paths.spectrum import target
from ..resampling.reservoir import Reservoir
from ..sampling.georgiev import RADIUS, SIGMA_I, SIGMA_S
from ..sampling.streams import Purpose
from ..shifts.scope import Scope
from .chain import Acceptance, Mutated, run_chain
from .kind import MutationPlan, Proposal, State
from .pivot import mutation_class

TEMPERATURE = 1e-3
"""T. The document has it "near 0"; energies are sums of about ten terms between 1/e and 1."""

SPACING = 4
"""Pixels of a set are this far apart where values are kept up to date: the energy's factor between
two of them is at most exp(-(4 / 2.1)²) = 0.03."""


@dataclass
class Surroundings:
    """What the rule compares with.

    Fields: ``grid``, ``values`` (of all pixels, see :func:`normalised`; evaluated),
    ``mean`` (mean luminance of the image).
    """

    grid: Grid
    values: mi.Float
    mean: mi.Float


def surroundings(grid: Grid, reservoirs: Reservoir) -> Surroundings:
    """The values that an image's reservoirs show, light seen directly left out."""
    shown = target(reservoirs.color) * reservoirs.weight
    mean = dr.mean(shown)
    around = Surroundings(grid, normalised(shown, mean), mean)
    dr.eval(around)
    return around


def normalised(luminance: mi.Float, mean: mi.Float) -> mi.Float:
    """x / (x + mean): from luminance to the values between 0 and 1 that the energy is made for."""
    total = luminance + mean
    return dr.select(total > 0, luminance / total, 0)


@dr.syntax
def energy_change(around: Surroundings, pixel: mi.UInt32, old: mi.Float, new: mi.Float) -> mi.Float:
    """e(new) - e(old): how a pixel's energy changes with its value (Georgiev and Fajardo 2016).

        e(s) = sum_q exp(-|p - q|²/sigma_i² - |s - s_q|^(1/2)/sigma_s²)

    over the neighbours q within :data:`mitsuba_restir.sampling.georgiev.RADIUS` pixels. What lies
    outside of the image does not count.

    Parameters
    ----------
    pixel : UInt32
        Index of each lane's pixel.
    old, new : Float
        Its values, see :func:`normalised`.
    """
    column_of, row_of = around.grid.place(pixel)
    x, y = mi.Int32(column_of), mi.Int32(row_of)
    width, height = mi.Int32(around.grid.width), mi.Int32(around.grid.height)
    row = mi.Int32(-RADIUS)
    change = mi.Float(0)
    while dr.hint(row <= RADIUS, exclude=[around, x, y, width, height, old, new], label="Energy"):
        there = y + row
        in_column = (there >= 0) & (there < height)
        row_factor = dr.exp(mi.Float(dr.square(row)) * (-1 / SIGMA_I**2))
        for column in range(-RADIUS, RADIUS + 1):
            beside = x + column
            inside = in_column & (beside >= 0) & (beside < width)
            inside &= dr.square(row) <= RADIUS**2 - column**2
            if column == 0:
                inside &= row != 0
            other = around.grid.index(mi.UInt32(beside), mi.UInt32(there))
            value = dr.gather(mi.Float, around.values, other, inside)
            factor = row_factor * math.exp(-(column**2) / SIGMA_I**2)
            change += dr.select(inside, factor * (_likeness(new, value) - _likeness(old, value)), 0)
        row += 1
    return change


def _likeness(a: mi.Float, b: mi.Float) -> mi.Float:
    return dr.exp(dr.sqrt(dr.abs(a - b)) * (-1 / SIGMA_S**2))


def energy_rule(
    around: Surroundings, pixel: mi.UInt32, weight: mi.Float, blend: float
) -> Acceptance:
    """The rule for lanes of given pixels.

    Parameters
    ----------
    pixel : UInt32
        Index of each lane's pixel.
    weight : Float
        Its weight W before the first mutation.
    blend : float
        w, from 0 (Metropolis-Hastings) to 1.
    """

    def acceptance(current: State, proposal: Proposal) -> mi.Float:
        before, after = target(current.color), target(proposal.state.color)
        change = energy_change(
            around,
            pixel,
            normalised(before * weight, around.mean),
            normalised(after * weight, around.mean),
        )
        annealed = dr.exp(dr.minimum(-change / TEMPERATURE, 0))
        ratio = dr.select(before > 0, after / before, 0)
        return (annealed * blend + ratio * (1 - blend)) * proposal.transition

    return acceptance


def mutate_by_energy(
    scope: Scope,
    reservoirs: Reservoir,
    hits: PrimaryHit,
    plan: MutationPlan,
    turn: mi.UInt32,
) -> tuple[Reservoir, Mutated]:
    """Mutate every pixel's path by the rule, against its neighbours' values before the pass.

    Parameters
    ----------
    reservoirs, hits : Reservoir, PrimaryHit
        One lane per pixel.
    turn : UInt32
        Number of the frame; every pixel has its turn in all of them.
    """
    around, pixel = surroundings(scope.grid, reservoirs), scope.grid.pixels()
    rule = energy_rule(around, pixel, reservoirs.weight, plan.energy_weight)
    return run_chain(scope, reservoirs, hits, pixel, plan, rule)


def mutate_by_updated_energy(
    scope: Scope,
    reservoirs: Reservoir,
    hits: PrimaryHit,
    plan: MutationPlan,
    turn: mi.UInt32,
) -> tuple[Reservoir, Mutated]:
    """The same against the neighbours' values as they are by now, in sets out of reach."""
    grid = scope.grid
    around = surroundings(grid, reservoirs)
    accepted, raised, lowered = (dr.zeros(mi.UInt32, grid.size) for _ in range(3))
    angle = dr.zeros(mi.Float, grid.size)
    total = Mutated(mi.UInt8(mutation_class(reservoirs.path)), accepted, raised, lowered, angle)
    result = dr.copy(reservoirs)
    dr.eval(total, result)
    # The order of the sets changes from frame to frame.
    first, _ = scope.key.stream(Purpose.ORDER, 0).words(0, 0)
    for index in range(SPACING**2):
        number = (first + dr.opaque(mi.UInt32, index)) % SPACING**2
        pixel, inside = spaced_pixels(grid, SPACING, number)
        own = dr.gather(Reservoir, reservoirs, pixel, inside)
        there = hits.at(pixel, inside)
        rule = energy_rule(around, pixel, own.weight, plan.energy_weight)
        moved, mutated = run_chain(scope, own, there, pixel, plan, rule)
        value = normalised(target(moved.color) * own.weight, around.mean)
        dr.scatter(result, moved, pixel, inside)
        dr.scatter(total, mutated, pixel, inside)
        dr.scatter(around.values, value, pixel, inside)
        dr.eval(result, total, around)
    return result, total
