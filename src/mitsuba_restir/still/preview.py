r"""Previews: what is shown of a still while it grows, steered so that its error is blue.

With x_i the value that frame i adds to the mean, P_n is shown in the place of the mean M_n of n
frames:

    P_n = ((n - 1) P_{n-1} + y_n) / n,    y_n = r_n + w c_n,    r_n = x_n - w m_n,

where m_n is the mean of the last round's pair estimators, w its weight in the mixture of the
frame's estimates, and c_n is m_n or another of the means that selection chooses from
(:mod:`mitsuba_restir.resampling.subsets`). All y_n are combinations of the frame's estimates with
fixed weights that sum to one, so P_n is a mean of n values like M_n, and

    P_n = M_n + (1/n) Σ w (c_i - m_i):

the mean, and a term that is for display only. The choice is that of
:mod:`mitsuba_restir.passes.select`, among colours P_n instead of those of a frame: of the energy
Σ |g_sigma * (P_n - a_n)|² the least over one pixel, the others given, against an aim a_n
(:mod:`.aim`), which is the mean so far without much of its noise.

That is error feedback over frames. Each choice goes on from P_{n-1}, and cancels what the last ones
left of error, against an aim that is better known by now. One choice moves a pixel by s / n, with s
the spread of its candidates. If only the newest frame were chosen, on top of M_{n-1}, that would be
all that there is against an error of s / sqrt(n), and the gain would fade as 1 / sqrt(n).

The choice depends on the values chosen from: P_n is biased, pixel against pixel, and its mean is
made that of M_n (:func:`mitsuba_restir.passes.select.as_bright`). It goes nowhere but to a screen:
neither the sums of the still nor its weights, checkpoint and frames know of it. Pixels whose mean
is not finite (or beyond 1e19, where its square is not) show what they have, unsteered, and count
for no other pixel: neither as what it is aimed at nor as error beside it.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from ..imageio import Image
from ..integrators.recording import Stage, collection_paused, frame_alone
from ..neighbors.around import among, similar_neighbors
from ..passes.select import Aim, as_bright, choose
from ..paths.grid import Grid, grid_of
from ..paths.primary_hit import PrimaryHit
from ..paths.spectrum import target
from ..resampling.pairwise import PairEstimators
from ..resampling.subsets import Round
from ..sampling.streams import FrameKey
from .accumulate import Layout, Size, Sums, estimates_of, image_of, mixed
from .aim import aim


@dataclass(frozen=True)
class Steering:
    """
    What stays the same from frame to frame.

    Attributes
    ----------
    layout : Layout
        Of a frame's channels.
    size : (int, int)
        Height and width [pixels].
    sigma : float
        Standard deviation of the Gaussian through which errors are seen [pixels].
    """

    layout: Layout
    size: Size
    sigma: float

    @property
    def grid(self) -> Grid:
        """The pixels."""
        return grid_of(self.size[1], self.size[0])


@dataclass
class Estimated:
    """What a frame leaves to choose from.

    Fields: ``hits`` (of all pixels), ``rounds`` (of spatial reuse).
    """

    hits: PrimaryHit
    rounds: list[Round]


@dataclass
class Added:
    """A frame that was added to a still.

    Fields: ``image`` (its film), ``weights`` (of its estimates), ``picture`` and ``products`` (what
    the picture's sums are with it), ``frames`` (how many there are with it; opaque).
    """

    image: mi.Float
    weights: list[mi.Float]
    picture: list[mi.Float]
    products: list[mi.Float]
    frames: mi.Float


class Preview:
    """
    The preview of a still.

    Parameters
    ----------
    steering : Steering
    """

    def __init__(self, steering: Steering) -> None:
        self._steering = steering
        # Two: what is recorded keeps all that it calculates until its end.
        self._aim = Stage(_aimed, steering)
        self._choose = Stage(_chosen, steering)
        self._bright = Stage(_bright, steering)
        self._shown: mi.Color3f | None = None

    def another(self) -> Preview:
        """One of another still, of frames with the same channels; with what is recorded."""
        result = copy.copy(self)
        result._shown = None
        return result

    def add(self, estimated: Estimated, added: Added, mean: list[mi.Float]) -> None:
        """
        Choose what is shown of the frame that was added last.

        Parameters
        ----------
        mean : list of Float
            What the picture's mean was before.
        """
        with frame_alone(), collection_paused():
            before = self._shown
            if before is None:
                # It may begin anywhere in a still, with the mean.
                before = mi.Color3f(*_by_pixels(self._steering.grid, mean))
                dr.eval(before)
            # As arrays of Dr.Jit's own: how NumPy's are aligned differs, and is recorded.
            weights = [weight + dr.opaque(mi.Float, 0) for weight in added.weights]
            dr.eval(weights)
            added = replace(added, weights=weights)
            aimed = self._aim(estimated.hits, added, before)
            self._shown = self._choose(estimated.rounds, added, before, aimed)

    def picture(self, sums: Sums) -> Image:
        """What is shown, (H, W, 3): the mean, as long as nothing was added."""
        if self._shown is None:
            return image_of(sums.picture.mean, self._steering.size)
        with frame_alone():
            shown = self._bright(self._shown, sums.picture.mean)
        return image_of(list(shown), self._steering.size)


def _aimed(
    steering: Steering, hits: PrimaryHit, added: Added, before: mi.Color3f
) -> tuple[mi.Color3f, mi.UInt32]:
    """What to come near to, and which neighbours count."""
    grid, frames = steering.grid, added.frames
    mean = mi.Color3f(*_by_pixels(grid, added.picture))
    deviation = mi.Color3f(
        *(
            dr.sqrt(square / dr.maximum(frames * (frames - 1), 1))
            for square in _by_pixels(grid, added.products)
        )
    )
    dr.eval(mean, deviation)
    # Squares, which are what the aim is made of, may be infinite where values are not.
    usable = mi.Bool(True)
    for color in (before, mean, deviation):
        usable &= dr.isfinite(dr.square(target(color)))
    alike = among(grid, similar_neighbors(grid, hits), usable)
    dr.eval(alike)
    return aim(grid, mean, deviation, frames, alike), alike


def _chosen(
    steering: Steering,
    known: list[Round],
    added: Added,
    before: mi.Color3f,
    aimed: tuple[mi.Color3f, mi.UInt32],
) -> mi.Color3f:
    """P_n, by pixels of the grid, from P_{n-1}."""
    grid, frames = steering.grid, added.frames
    newest = mixed(added.weights, estimates_of(steering.layout, added.image))
    newest = mi.Color3f(*_by_pixels(grid, list(newest)))
    share = mi.Float(1)
    if added.weights:
        (share,) = _by_pixels(grid, added.weights[-1:])
    dr.eval(newest, share)
    rest = newest - share * known[-1].mean
    # Rounding may leave it below zero. What is not a number stays so: maxima differ in that.
    rest = dr.select(rest < 0, 0, rest)

    def in_mean(color: mi.Color3f) -> mi.Color3f:
        return before + (rest + share * color - before) / frames

    rounds = [
        Round(
            in_mean(each.mean),
            PairEstimators([in_mean(c) for c in each.estimators.colors], each.estimators.valid),
        )
        for each in known
    ]
    rounds[-1].mean = before + (newest - before) / frames
    dr.eval(rounds)
    # The seed only draws in which order pixels choose.
    key = FrameKey(mi.UInt32(frames), dr.opaque(mi.UInt32, 0))
    return choose(grid, key, rounds, Aim(*aimed, steering.sigma))


def _bright(steering: Steering, shown: mi.Color3f, picture: list[mi.Float]) -> mi.Color3f:
    """As bright as the mean, row by row."""
    rows = dr.gather(mi.Color3f, shown, steering.grid.by_rows())
    return as_bright(rows, mi.Color3f(*picture))


def _by_pixels(grid: Grid, rows: list[mi.Float]) -> list[mi.Float]:
    """Values row by row, in the order of the grid."""
    place = grid.by_pixels()
    return [dr.gather(mi.Float, values, place) for values in rows]
