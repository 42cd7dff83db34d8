"""From a scene to its still: the public function, and the choice of a plan before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np

from ..analysis import denoise as denoiser
from ..integrators.images import images_of
from ..integrators.recording import frame_alone
from .frames import Frames, Subject, check_parameters
from .goal import Goal, goal_of
from .growth import Growth
from .picture import Progress, Still, stopwatch
from .pilot import DENOISED, RAW, Render, pilot
from .plan import PLANS, Plan, parse

DARK_PLAN = PLANS["candidates"]
"""Of scenes without light."""


def render(
    scene: mi.Scene,
    sensor: int | mi.Sensor | None = None,
    max_depth: int = -1,
    error: float | None = None,
    seconds: float | None = None,
    frames: int | None = None,
    denoise: bool = False,
    plan: str | Plan | None = None,
    seed: int = 0,
    progress: Callable[[Progress], None] | None = None,
    **parameters: Any,
) -> Still:
    """
    Render one picture: the mean of independent frames, to a stated error.

    Parameters
    ----------
    scene : Scene
        Its film must have a ``box`` filter if the picture is to be denoised.
    sensor : int or Sensor, optional
        The scene's first one by default.
    max_depth : int
        Longest path depth, -1 for no limit.
    error : float, optional
        Stop as soon as the stated relative error (`Still.error`) is as small; 0.05 if neither
        ``seconds`` nor ``frames`` is given. It is looked at when there are 4, 5, 7, 9, 12, ...
        frames. To stop by an estimate is a small bias in itself, towards pictures whose error is
        underestimated; ``seconds`` and ``frames`` have none.
    seconds : float, optional
        Stop when the next frame would end later, the choice of the plan included.
    frames : int, optional
        Stop after so many frames, at least 2.
    denoise : bool
        Denoise the picture as well; its plan is then one without reuse, see
        :data:`.pilot.DENOISED`.
    plan : str or Plan, optional
        What the frames are rendered with; a name of :data:`.plan.PLANS`, or values as ``spp=8,
        spatial_rounds=5``. By default a short pilot measures what is best for the scene; its frames
        are not part of the picture.
    seed : int
        From 0 to 2^32 - 1.
    progress : callable, optional
        Called with a `Progress` after each frame.
    **parameters
        Further parameters of ``restir_pt``, set whatever the plan says, and ``aovs``.

    Returns
    -------
    Still

    Raises
    ------
    ValueError
        An argument is not allowed, or the integrator refuses the scene.
    ImportError
        A denoised picture is asked for, and the denoiser is not installed.
    """
    elapsed = stopwatch()
    goal = goal_of(error, seconds, frames)
    if denoise:
        denoiser.require()
    aovs = dict(images_of(str(parameters.pop("aovs", ""))))
    check_parameters(parameters)
    if not isinstance(sensor, mi.Sensor):
        with frame_alone():
            sensor = scene.sensors()[sensor or 0]
    subject = Subject(
        scene, sensor, seed, {"max_depth": max_depth, **parameters}, aovs, guides=denoise
    )
    asked = parse(plan) if isinstance(plan, str) else plan
    growth = begun(subject, asked, goal, elapsed)
    for now in growth.grow(goal):
        if progress is not None:
            progress(now)
    return growth.still(denoise)


def begun(subject: Subject, plan: Plan | None, goal: Goal, elapsed: Callable[[], float]) -> Growth:
    """
    A still without a frame, with the plan that is given or found by a pilot.

    Parameters
    ----------
    elapsed : callable
        Seconds since the still was asked for.
    """
    if plan is not None:
        return Growth(Frames(subject, plan), "asked for", elapsed)
    if not subject.lit:
        return Growth(Frames(subject, DARK_PLAN), "there is nothing to plan for", elapsed)
    return _piloted(subject, goal, elapsed)


def _piloted(subject: Subject, goal: Goal, elapsed: Callable[[], float]) -> Growth:
    """With the plan that a pilot finds; its frames share nothing with the picture's but kernels."""
    apart = replace(subject, seed=_other_seed(subject.seed))
    tried: dict[str, Frames] = {}

    def begin(plan: Plan) -> Render:
        tried[plan.name] = Frames(apart, plan)
        return tried[plan.name].luminances

    choice = pilot(begin, goal, DENOISED if subject.guides else RAW)
    frames = tried.get(choice.plan.name)
    if frames is None:
        frames = Frames(subject, choice.plan)
    frames.restart(subject.seed)
    return Growth(frames, choice.why, elapsed)


def _other_seed(seed: int) -> int:
    return int(np.random.SeedSequence(seed, spawn_key=(1,)).generate_state(1)[0])
