"""What steering could make of a growing still: the figures of docs/blue_noise.md, "Previews".

    python docs/previews.py

A wall of made-up estimates, four to a pixel and frame, frames independent as those of a still.
Shown is the mean so far with another estimate of the newest frame ("newest"), or the mean of what
was chosen in every frame ("every"), aimed at the smoothed mean so far or at the truth. Printed is
the power of its error in .06 to .17 cycles per pixel, relative to the plain mean's.
"""

from __future__ import annotations

# isort: off
import mitsuba_restir  # noqa: F401  (first: it finds LLVM)

# isort: on
import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_restir.analysis.spectrum import TABLE_BANDS, band_power, power_spectrum
from mitsuba_restir.neighbors.around import OFFSETS, similar_further
from mitsuba_restir.neighbors.color_history import ColorHistory, smoothed
from mitsuba_restir.passes.select import Aim, as_bright, choose
from mitsuba_restir.paths.grid import Grid, grid_of
from mitsuba_restir.resampling.pairwise import PairEstimators
from mitsuba_restir.resampling.subsets import Round
from mitsuba_restir.sampling.streams import FrameKey

SIZE = (192, 128)
PAIRS, CHAINS = 3, 4
COUNTS = (1, 4, 16, 64)
SHAPES = {"smooth": (1.0, 2.0), "heavy tails": (0.15, 1.0)}
"""Share of the estimates that are lit, and shape of the gamma distribution of those."""


def everywhere(grid: Grid) -> mi.UInt32:
    """All neighbours in the image count."""
    bits = mi.UInt32(0)
    for i, offset in enumerate(OFFSETS):
        _, inside = grid.look(grid.pixels(), *offset)
        bits |= dr.select(inside, mi.UInt32(1 << i), 0)
    dr.eval(bits)
    return bits


def show(grid: Grid, frame: int, newest: Round, before: mi.Color3f, mean: mi.Color3f, truth: bool):
    """The mean so far, with a choice of the newest frame's estimates on top of what is before."""
    share = 1 / (frame + 1)
    colors = [dr.lerp(before, color, share) for color in newest.estimators.colors]
    shared = Round(
        dr.lerp(before, newest.mean, share), PairEstimators(colors, newest.estimators.valid)
    )
    alike = everywhere(grid)
    known = ColorHistory(mean, dr.full(mi.Float, frame + 1, grid.size), mi.Color3f(0), alike)
    aim = smoothed(grid, known, alike, similar_further(grid, alike))
    aim = dr.full(mi.Color3f, 1, grid.size) if truth else aim
    key = FrameKey(dr.opaque(mi.UInt32, frame), dr.opaque(mi.UInt32, 1))
    dr.eval(shared)
    return as_bright(choose(grid, key, [shared], Aim(aim, alike, 0.8)), mean)


def ratios(lit: float, shape: float, truth: bool) -> np.ndarray:
    """Power of "newest" and "every" by the plain mean's, after each count of frames."""
    grid, found = grid_of(*SIZE), np.zeros((len(COUNTS), 3))
    for chain in range(CHAINS):
        rng = np.random.default_rng(chain)
        mean, every = (dr.zeros(mi.Color3f, grid.size) for _ in range(2))
        for frame in range(max(COUNTS)):
            values = rng.gamma(shape, 1 / (shape * lit), (PAIRS + 1, grid.size))
            values *= rng.random(values.shape) < lit
            colors = [mi.Color3f(mi.Float(v.astype(np.float32))) for v in values]
            valid = [dr.ones(mi.Bool, grid.size)] * (PAIRS + 1)
            newest = Round(sum(colors, mi.Color3f(0)) / (PAIRS + 1), PairEstimators(colors, valid))
            before, mean = mean, dr.lerp(mean, newest.mean, 1 / (frame + 1))
            every = show(grid, frame, newest, every, mean, truth)
            if frame + 1 in COUNTS:
                chosen = show(grid, frame, newest, before, mean, truth)
                for i, image in enumerate((mean, chosen, every)):
                    errors = grid.image(np.array(image)[1]) - 1
                    power = band_power(power_spectrum(errors), TABLE_BANDS[1:])
                    found[COUNTS.index(frame + 1), i] += power[0]
    return found[:, 1:] / found[:, :1]


def main() -> None:
    """Print all ratios."""
    mi.set_variant("llvm_ad_rgb")
    for name, (lit, shape) in SHAPES.items():
        for truth in (False, True):
            for count, (newest, every) in zip(COUNTS, ratios(lit, shape, truth), strict=True):
                aim = "the truth" if truth else "the smoothed mean"
                print(
                    f"{name}, aimed at {aim}, {count} frames: newest {newest:.3f} every {every:.3f}"
                )


if __name__ == "__main__":
    main()
