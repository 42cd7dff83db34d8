"""Rendering frame after frame: warm-up, time budget, progress."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ..imageio import Image
from .progress import bar


@dataclass(frozen=True)
class Schedule:
    """
    How many frames to render.

    Fields
    ------
    frames : int or None
        Frames to keep; None goes on until the time is used up.
    warmup : int
        Frames rendered before them and thrown away.
    time_budget : float or None
        Seconds; no frame is begun that would, at the pace of the last one, end later.
    start : int
        The first frame to keep; the warm-up is before it.
    """

    frames: int | None
    warmup: int = 0
    time_budget: float | None = None
    start: int = 0


def run_frames(
    render: Callable[[int], Image],
    schedule: Schedule,
    clock: Callable[[], float] = time.perf_counter,
) -> Iterator[tuple[int, Image]]:
    """
    Render the frames of a schedule and yield those to keep.

    The first frame to keep is rendered however small the budget is, so that there is a result.

    Parameters
    ----------
    render : callable
        Renders one frame; gets its number, negative in a warm-up before the first of all.
    schedule : Schedule
    clock : callable
        Time in seconds.

    Yields
    ------
    (int, array)
        Frame number, and its image.
    """
    budget = schedule.time_budget
    begin = clock()
    pace = 0.0
    frame = schedule.start - schedule.warmup
    with bar("{task.fields[state]}") as progress:
        total = (
            None if schedule.frames is None else schedule.warmup + schedule.frames - schedule.start
        )
        task = progress.add_task("rendering", total=budget if total is None else total, state="")
        for done in itertools.count():
            if schedule.frames is not None and frame >= schedule.frames:
                return
            elapsed = clock() - begin
            if budget is not None and elapsed + pace > budget:
                if frame > schedule.start:
                    return
                frame = schedule.start
            state = "warm-up" if frame < schedule.start else f"frame {frame}"
            if budget is not None:
                state += f", {max(0.0, budget - elapsed):.0f} s of the budget left"
            progress.update(task, completed=elapsed if total is None else done, state=state)
            start = clock()
            image = render(frame)
            pace = clock() - start
            if frame >= schedule.start:
                yield frame, image
            frame += 1
