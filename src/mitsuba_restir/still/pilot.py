"""The pilot: a few frames of some plans, of which none gets into the picture, and one is chosen."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from .goal import Goal
from .mix import mixture
from .plan import PLANS, Plan

FloatArray = NDArray[np.float64]

Render = Callable[[int], FloatArray]
"""Renders the next frame with so many trees a pixel: luminances of its K estimates, (K, H, W), the
last the frame itself."""

SHARE = 0.1
"""Longest pilot, as a share of the time that there is for the picture."""

LONGEST = 4.0
"""Longest pilot [s]."""

TREES = 4
"""Trees a pixel of the frames of plans with reuse: enough to compare plans at equal trees, in less
time."""

LEARNT = 4
"""Frames after which a guide has learnt most of what it will have learnt."""

LEAST, MOST = 2, 3
"""Frames of a plan that are measured."""

TIMED = 2
"""Trees a pixel of the frames of plans without reuse; they say what a tree takes."""

DEAR = 3
"""A guess of what a frame with reuse takes, in those frames, before one has been seen."""

TRIMMED = 0.001
"""Share of the pixels with the largest errors that are left out."""

AROUND = 3.0
"""Variance is relative to what is seen through a Gaussian of this standard deviation [pixels]."""

WORTH = 0.9
"""A plan takes the place of another only where it needs less than this share of its time."""

ALONE = "candidates"
"""The plan without reuse. Its frames give the time that a tree takes; its error is that of the
candidates in the frames of another plan, where there is one, in which as much of the tail is
met."""

DARK = 0.5
"""Share of the pixels with light, in a frame without reuse, below which a scene is dark."""


@dataclass(frozen=True)
class Trial:
    """
    The plans that are tried beside the one without reuse.

    Attributes
    ----------
    dark, lit : tuple of str
        In the order in which they are, in a scene where light is hard to find and in another. The
        first one of a dark scene is for those who have no time.
    hurried : str
        For those who have no time in a scene that is lit.
    """

    dark: tuple[str, ...]
    lit: tuple[str, ...]
    hurried: str


RAW = Trial(
    ("rounds_guided", "rounds", "light_guided", "shared", "light"),
    ("rounds", "shared", "light", "rounds_guided", "light_guided"),
    "rounds",
)
"""Of pictures that are seen as they are."""

DENOISED = Trial(("candidates_guided",), ("candidates_guided",), ALONE)
"""Of pictures that will be denoised: what reuse would remove a denoiser removes, and what reuse
leaves is correlated. relMSE after OIDN without the worst 0.1 %, 256x144, 6 s, two pictures each, of
guided candidates, unguided ones, and of ``light``, ``light_guided`` and five rounds of 6 neighbours
within 10 pixels: Veach Ajar 0.0114, 0.0141, 0.0130, 0.0114, 0.0137; ``ajar`` 0.0059, 0.0063,
0.0056, 0.0057, 0.0072; ``gloss`` 0.0039, 0.0037, 0.0044, 0.0045, 0.0062. Between plans with reuse
and without it, a pilot's frames did not foretell that order, even through a Gaussian of 3 pixels.
"""


@dataclass(frozen=True)
class Measured:
    """
    What the pilot found of a plan.

    Attributes
    ----------
    plan : Plan
    seconds : float
        Of one of the frames that were measured.
    frames : ndarray, (N, K, H, W)
        Luminances of their estimates.
    """

    plan: Plan
    seconds: float
    frames: FloatArray


@dataclass(frozen=True)
class Choice:
    """
    The plan of a picture.

    Attributes
    ----------
    plan : Plan
    why : str
        In one line.
    seconds : float
        That the pilot took.
    """

    plan: Plan
    why: str
    seconds: float


def pilot(
    begin: Callable[[Plan], Render],
    goal: Goal,
    trial: Trial = RAW,
    clock: Callable[[], float] = time.perf_counter,
) -> Choice:
    """
    Measure variance x time of some plans, as many as there is time for, and choose one.

    Parameters
    ----------
    begin : callable
        Prepares to render independent frames of a plan. They must not be those of the picture:
        another seed makes them independent of it.
    goal : Goal
        Of the picture. Unless it is a time, the time is what the best plan so far would take.
    trial : Trial
    clock : callable
        Seconds.
    """
    start = clock()
    end = start + _allowed(goal, [])
    render = begin(PLANS[ALONE])
    # The first frame of a plan is compiled and recorded: its time says nothing.
    dark = bool(np.mean(render(TIMED) > 0) < DARK)
    hurried = Choice(
        PLANS[trial.dark[0] if dark else trial.hurried],
        "there was no time to compare it with others",
        clock() - start,
    )
    if clock() >= end:
        return hurried
    alone = _measure(PLANS[ALONE], render, clock, end)
    end = start + _allowed(goal, [alone])
    measured: list[Measured] = []
    expected = 0.0
    for name in trial.dark if dark else trial.lit:
        plan, began = PLANS[name], clock()
        learning = LEARNT * _trees(plan) * alone.seconds / TIMED if plan.learns else 0
        guess = (1 + LEAST) * alone.seconds * (DEAR if plan.mixes else 1)
        if began + learning + (expected or guess) > end:
            break
        render = begin(plan)
        render(1)
        measured.append(_measure(plan, render, clock, end))
        end = start + _allowed(goal, [*measured, alone])
        expected = clock() - began - learning
    if not measured:
        return replace(hurried, seconds=clock() - start)
    for other in measured:
        if other.plan.mixes and not other.plan.learns:
            seconds_alone = alone.seconds * TREES / TIMED
            alone = replace(alone, seconds=seconds_alone, frames=other.frames[:, :1])
            break
    return choose([*measured, alone], clock() - start)


def choose(measured: Sequence[Measured], seconds: float) -> Choice:
    """
    The plan that needs the least time for an error.

    Parameters
    ----------
    measured : sequence of Measured
        With reuse, at equal trees; the last is chosen where no other is clearly better.
    seconds : float
        That the pilot took.
    """
    costs = _costs(measured)
    best = len(measured) - 1
    for index, cost in enumerate(costs):
        best = index if cost < WORTH * costs[best] else best
    return Choice(measured[best].plan, _why(measured, costs, best), seconds)


def _costs(measured: Sequence[Measured]) -> list[float]:
    """Relative variance x time [s] of each."""
    mean = measured[0].frames[:, -1].mean(axis=0)
    size = gaussian_filter(mean, AROUND, mode="nearest")
    scale = np.sqrt(size**2 + (0.01 * mean.mean()) ** 2) + np.finfo(np.float64).tiny
    return [each.seconds * error(each.frames / scale) for each in measured]


def _allowed(goal: Goal, measured: Sequence[Measured]) -> float:
    """Seconds that a pilot may take, by what has been measured so far."""
    if goal.seconds is not None:
        picture = goal.seconds
    elif not measured:
        return LONGEST
    elif goal.error is not None:
        picture = min(_costs(measured)) / goal.error**2
    else:
        assert goal.frames is not None
        picture = goal.frames * min(m.seconds * m.plan.spp / _trees(m.plan) for m in measured)
    return min(LONGEST, SHARE * picture)


def error(frames: FloatArray) -> float:
    """
    Variance of a frame, mean over the pixels without the worst.

    Parameters
    ----------
    frames : ndarray, (N, K, H, W)
        Relative luminances of the estimates; N is at least 2.
    """
    count = len(frames)
    deviation = frames - frames.mean(axis=0)
    covariance = np.einsum("nihw,njhw->ijhw", deviation, deviation) / (count - 1)
    mixed = np.einsum("khw,nkhw->nhw", mixture(covariance, count), deviation)
    variance = np.sort((mixed**2).sum(axis=0) / (count - 1), axis=None)
    return float(variance[: max(1, round(variance.size * (1 - TRIMMED)))].mean())


def _why(measured: Sequence[Measured], costs: Sequence[float], best: int) -> str:
    if not costs[best] > 0:
        return "no plan found light with noise"
    others = [
        f"{each.plan.name} {cost / costs[best]:.2g}"
        for index, (each, cost) in enumerate(zip(measured, costs, strict=True))
        if index != best
    ]
    return f"variance x time, relative to its own: {', '.join(others)}"


def _measure(plan: Plan, render: Render, clock: Callable[[], float], end: float) -> Measured:
    """Render some frames of a plan; no more than needed after the end."""
    trees = _trees(plan)
    for _ in range(LEARNT if plan.learns else 0):
        if clock() < end:
            render(trees)
    frames: list[FloatArray] = []
    times: list[float] = []
    while len(frames) < LEAST or (len(frames) < MOST and clock() < end):
        began = clock()
        frames.append(np.asarray(render(trees), dtype=np.float64))
        times.append(clock() - began)
    return Measured(plan, min(times), np.stack(frames))


def _trees(plan: Plan) -> int:
    return TREES if plan.mixes else TIMED
