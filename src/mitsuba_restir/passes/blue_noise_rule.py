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
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.spectrum import target
from ..resampling.reservoir import Reservoir
from ..sampling.georgiev import RADIUS, SIGMA_I, SIGMA_S
from ..sampling.streams import MUTATION, pass_stream
from ..shifts.mapping import ShiftMapping
from ..shifts.perturb import State
from ..shifts.pivot import mutation_class
from .decorrelate import Acceptance, Mutated, decorrelate
from .neighborhood import pixels_of_set, set_lanes

TEMPERATURE = 1e-3
"""T. The document has it "near 0"; energies are sums of about ten terms between 1/e and 1."""

SPACING = 4
"""Pixels of a set are this far apart where values are kept up to date: the energy's factor between
two of them is at most exp(-(4 / 2.1)²) = 0.03."""


@dataclass
class Surroundings:
    """What the rule compares with.

    Fields: ``values`` (``Float``, of all pixels, row-major, see :func:`normalised`; evaluated),
    ``mean`` (``Float``, mean luminance of the image), ``width`` and ``height`` (``UInt32``).
    """

    values: Any
    mean: Any
    width: Any
    height: Any


def surroundings(reservoirs: Reservoir, size: tuple[Any, Any]) -> Surroundings:
    """The values that an image's reservoirs show, light seen directly left out."""
    shown = target(reservoirs.color) * reservoirs.weight
    mean = dr.mean(shown)
    around = Surroundings(normalised(shown, mean), mean, *size)
    dr.eval(around)
    return around


def normalised(luminance: Any, mean: Any) -> Any:
    """x / (x + mean): from luminance to the values between 0 and 1 that the energy is made for."""
    total = luminance + mean
    return dr.select(total > 0, luminance / total, 0)


@dr.syntax
def energy_change(around: Surroundings, pixel: Any, old: Any, new: Any) -> Any:
    """e(new) - e(old): how a pixel's energy changes with its value (Georgiev and Fajardo 2016).

        e(s) = sum_q exp(-|p - q|²/sigma_i² - |s - s_q|^(1/2)/sigma_s²)

    over the neighbours q within :data:`mitsuba_restir.sampling.georgiev.RADIUS` pixels. What lies
    outside of the image does not count.

    Parameters
    ----------
    pixel : UInt32
        Row-major index of each lane's pixel.
    old, new : Float
        Its values, see :func:`normalised`.
    """
    y = pixel // around.width
    x = mi.Int32(pixel - y * around.width)
    width, height = mi.Int32(around.width), mi.Int32(around.height)
    row = mi.Int32(-RADIUS)
    change = mi.Float(0)
    while dr.hint(row <= RADIUS, exclude=[around, x, y, width, height, old, new], label="Energy"):
        there = mi.Int32(y) + row
        in_column = (there >= 0) & (there < height)
        row_factor = dr.exp(mi.Float(dr.square(row)) * (-1 / SIGMA_I**2))
        for column in range(-RADIUS, RADIUS + 1):
            beside = x + column
            inside = in_column & (beside >= 0) & (beside < width)
            inside &= dr.square(row) <= RADIUS**2 - column**2
            if column == 0:
                inside &= row != 0
            value = dr.gather(mi.Float, around.values, there * width + beside, inside)
            factor = row_factor * math.exp(-(column**2) / SIGMA_I**2)
            change += dr.select(inside, factor * (_likeness(new, value) - _likeness(old, value)), 0)
        row += 1
    return change


def _likeness(a: Any, b: Any) -> Any:
    return dr.exp(dr.sqrt(dr.abs(a - b)) * (-1 / SIGMA_S**2))


def blue_noise_rule(around: Surroundings, pixel: Any, weight: Any, blend: float) -> Acceptance:
    """The rule for lanes of given pixels.

    Parameters
    ----------
    pixel : UInt32
        Row-major index of each lane's pixel.
    weight : Float
        Its weight W before the first mutation.
    blend : float
        w, from 0 (Metropolis-Hastings) to 1.
    """

    def acceptance(current: State, proposed: State, transition: Any) -> Any:
        before, after = target(current.color), target(proposed.color)
        change = energy_change(
            around,
            pixel,
            normalised(before * weight, around.mean),
            normalised(after * weight, around.mean),
        )
        annealed = dr.exp(dr.minimum(-change / TEMPERATURE, 0))
        ratio = dr.select(before > 0, after / before, 0)
        return (annealed * blend + ratio * (1 - blend)) * transition

    return acceptance


def mutate_by_rule(
    scene: mi.Scene,
    sensor: mi.Sensor | None,
    reservoirs: Reservoir,
    hits: PrimaryHit,
    size: tuple[int, int],
    mutations: int,
    step: float,
    sample: Any,
    seed: Any,
    mapping: ShiftMapping,
    blend: float,
    updated: bool,
) -> tuple[Reservoir, Mutated]:
    """Mutate every pixel's path by the rule.

    Parameters
    ----------
    reservoirs, hits : Reservoir, PrimaryHit
        One lane per pixel.
    size : (int, int)
        Width and height in pixels.
    blend : float
        w.
    updated : bool
        Compare with the neighbours' values as they are by now, a sixteenth of the pixels moving at
        a time. Otherwise with those before the pass, as in the document.
    """
    pixels = math.prod(size)
    width, height = (dr.opaque(mi.UInt32, n) for n in size)
    around = surroundings(reservoirs, (width, height))
    steps = (mutations, step, sample, seed, mapping)
    if not updated:
        pixel = dr.arange(mi.UInt32, pixels)
        rule = blue_noise_rule(around, pixel, reservoirs.weight, blend)
        return decorrelate(scene, sensor, reservoirs, hits, *steps, rule)

    accepted, raised, lowered = (dr.zeros(mi.UInt32, pixels) for _ in range(3))
    angle = dr.zeros(mi.Float, pixels)
    total = Mutated(mutation_class(reservoirs.path), accepted, raised, lowered, angle)
    result = dr.copy(reservoirs)
    dr.eval(total, result)
    # The order of the sets changes from frame to frame: the stream of the pixel after the last.
    order = pass_stream(MUTATION, dr.opaque(mi.UInt32, pixels), sample, seed)
    first, _ = order.words(0, 0)
    for index in range(SPACING**2):
        number = (first + dr.opaque(mi.UInt32, index)) % SPACING**2
        pixel, inside = pixels_of_set(number, SPACING, set_lanes(size, SPACING), width, height)
        own = dr.gather(Reservoir, reservoirs, pixel, inside)
        there = dr.gather(PrimaryHit, hits, pixel, inside)
        rule = blue_noise_rule(around, pixel, own.weight, blend)
        moved, mutated = decorrelate(scene, sensor, own, there, *steps, rule, pixel)
        value = normalised(target(moved.color) * own.weight, around.mean)
        dr.scatter(result, moved, pixel, inside)
        dr.scatter(total, mutated, pixel, inside)
        dr.scatter(around.values, value, pixel, inside)
        dr.eval(result, total, around)
    return result, total
