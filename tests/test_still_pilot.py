"""The pilot: it takes its time and no more, and finds the plan that needs the least."""

from __future__ import annotations

import numpy as np
import pytest

from mitsuba_restir.still.goal import Goal
from mitsuba_restir.still.pilot import (
    ALONE,
    DENOISED,
    LONGEST,
    RAW,
    SHARE,
    Choice,
    Measured,
    Trial,
    choose,
    error,
    pilot,
)
from mitsuba_restir.still.plan import PLANS

SHAPE = (40, 64)


class Studio:
    """Renders made-up frames of plans by a clock of its own.

    Parameters
    ----------
    variances : dict of str to float
        Of a tree of each plan; 1 for others.
    seconds : float
        That a tree takes; reuse takes that of four.
    tail : float
        Share of the pixels in which a frame finds most of its light; 1 for no tail.
    offset : float
        Mean, less what is missing where that light is not found.
    """

    def __init__(
        self,
        variances: dict[str, float],
        seconds: float = 0.02,
        tail: float = 1,
        offset: float = 2,
    ) -> None:
        self.variances, self.seconds, self.tail = variances, seconds, tail
        self.offset = offset
        self.now = 0.0
        self.rendered: list[str] = []
        self.rng = np.random.default_rng(8)

    def begin(self, plan):
        self.now += 0.1
        estimates = 3 if plan.mixes else 1
        scale, alone = (
            np.sqrt(self.variances.get(name, 1.0) * self.tail) for name in (plan.name, ALONE)
        )

        def render(trees):
            self.now += self.seconds * (trees + 4 * plan.mixes)
            self.rendered.append(plan.name)
            found = self.rng.random(SHAPE) < self.tail
            light = found * self.rng.exponential(1 / self.tail, SHAPE) - 1
            light *= np.sqrt(1 / trees)
            frame = np.repeat((self.offset + scale * light)[None], estimates, axis=0)
            if plan.mixes:
                frame[0] = self.offset + alone * light
            return frame

        return render

    def clock(self) -> float:
        return self.now

    def pilot(self, goal: Goal, trial: Trial = RAW) -> Choice:
        return pilot(self.begin, goal, trial, self.clock)


@pytest.mark.parametrize("best", [ALONE, *RAW.lit])
@pytest.mark.parametrize("tail", [1, 0.02])
def test_the_best_plan_is_found(best, tail):
    """With a fifth of the variance of the others, be the tails light or heavy."""
    choice = Studio({best: 0.2}, 0.01, tail).pilot(Goal(error=1e-3))
    assert choice.plan.name == best
    assert f"{RAW.lit[0] if best != RAW.lit[0] else RAW.lit[1]} " in choice.why
    assert "\n" not in choice.why


@pytest.mark.parametrize("seconds", [1.0, 10.0, 60.0, 600.0])
@pytest.mark.parametrize("kind", ["seconds", "error", "frames"])
def test_a_pilot_is_short(seconds, kind):
    """It ends in time but for a last plan's least frames, and for the plan of single trees."""
    studio = Studio({})
    # Candidates alone have a relative variance of 1/4 a tree, in frames of 4 trees.
    cost = studio.seconds / 4
    goals = {"error": (cost / seconds) ** 0.5, "frames": round(seconds / (4 * studio.seconds))}
    choice = studio.pilot(Goal(**{kind: goals.get(kind, seconds)}))
    limit = 1.1 * min(LONGEST, SHARE * seconds)
    assert choice.seconds == pytest.approx(studio.now)
    frame = 8 * studio.seconds
    assert choice.seconds <= max(limit, 0.1 + 4 * studio.seconds) + 3 * frame


@pytest.mark.parametrize("best", [ALONE, *DENOISED.lit])
def test_before_a_denoiser_the_guide_has_to_pay(best):
    choice = Studio({best: 0.5}, 0.01).pilot(Goal(seconds=10.0), DENOISED)
    assert choice.plan.name == best


def test_without_time_nothing_is_compared():
    for trial, lit, dark in ((RAW, "rounds", "rounds_guided"), (DENOISED, ALONE, *DENOISED.dark)):
        for plan, offset in ((lit, 2.0), (dark, 0.0)):
            choice = Studio({ALONE: 1e-3}, tail=0.02, offset=offset).pilot(Goal(seconds=0.5), trial)
            assert choice.plan.name == plan
            assert "no time" in choice.why


def test_time_counts():
    """Half of the variance at three times the time is a bad bargain."""
    rng = np.random.default_rng(2)
    frames = 2 + rng.normal(size=(3, 1, *SHAPE))
    plans = [PLANS["rounds"], PLANS["candidates"]]
    dear = Measured(plans[0], 3.0, 2 + (frames - 2) / np.sqrt(2))
    cheap = Measured(plans[1], 1.0, frames)
    assert choose([dear, cheap], 0).plan is plans[1]
    assert choose([cheap, dear], 0).plan is plans[1]


def test_a_few_fireflies_do_not_decide():
    frames = np.random.default_rng(4).normal(size=(3, 1, *SHAPE))
    lit = frames.copy()
    lit[1, 0, 20, 30] = 1e4
    assert error(lit) == pytest.approx(error(frames), rel=0.01)


def test_without_light_there_is_a_plan():
    measured = [
        Measured(PLANS[name], 1.0, np.zeros((2, 3, *SHAPE))) for name in ("rounds", "light")
    ]
    with np.errstate(all="raise", under="ignore"):
        choice = choose(measured, 0)
    assert choice.plan.name == "light"
    assert "no plan found light" in choice.why


def test_plans_that_are_tried_exist():
    assert {ALONE, *RAW.lit, *DENOISED.lit} <= PLANS.keys()
    assert set(RAW.lit) == set(RAW.dark)
    assert set(DENOISED.lit) == set(DENOISED.dark)
