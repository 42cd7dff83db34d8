"""What comes next: a frame that follows the camera, a still that grows, or the same frame anew."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from . import encode, pace, views
from .camera import Pose
from .exchange import Plots, Published, Task
from .model import COLOUR, Settings
from .pace import Pace
from .reference import Reference, relmse, spectrum
from .renderer import RECORDED, Renderer, Shot
from .resting import SHOWN_FROM, Resting
from .views import VIEWS, Drawn

SETTLED = 1.0
"""Seconds of rest before a still begins."""

BETWEEN_STILLS, BETWEEN_PLOTS = 0.3, 0.5
"""Seconds between two pictures of a still, and between two sets of plots."""


class Director:
    """
    Turns tasks into pictures.

    Parameters
    ----------
    renderer : Renderer
    reference : Reference or None
        Of the camera's first place.
    announce : callable
        Is told what takes longer than a frame.
    clock : callable
        Time in seconds.

    Attributes
    ----------
    plots : Plots
        Of the last picture.
    """

    def __init__(
        self,
        renderer: Renderer,
        reference: Reference | None,
        announce: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.plots = Plots()
        self._renderer = renderer
        self._given = self._reference = reference
        self._announce = announce
        self._clock = clock
        self._pace = Pace()
        self._sizes = [pace.size_at(renderer.full, n) for n in range(len(pace.SCALES))]
        self._numbers: Iterator[int] = itertools.count(1)
        self._shots: tuple[Shot, ...] = ()
        self._resting: Resting | None = None
        self._last: Task | None = None
        self._rested = self._plotted = self._timed = -1e9
        self._drawn_as: Settings | None = None
        self._frames = 0
        self._finished = self._stands = False
        self._errors: list[float | None] = []

    def picture(self, task: Task) -> Published | None:
        """
        Do the next thing.

        Returns
        -------
        Published or None
            None where there is nothing new to show.

        Raises
        ------
        ValueError
            What is asked for cannot be rendered, or shown.
        """
        before, self._last = self._last, task
        if before is not None and self._starts_anew(before, task):
            self._renderer.reset()
            self._resting = None
            self._frames = 0
        if before is not None and task.kept != before.kept:
            self._keep(task.pose)
        stepped = before is None or task.steps != before.steps
        if task.settings.frozen and not stepped and self._shots:
            return self._frozen(task)
        if self._accumulates(task):
            return self._grown(task)
        return self._live(task)

    @property
    def done(self) -> bool:
        """Whether the next picture would be the same as the last one."""
        assert self._last is not None
        return self._last.settings.frozen or (
            self._resting is not None and self._accumulates(self._last) and self._finished
        )

    def _starts_anew(self, before: Task, task: Task) -> bool:
        """Whether histories are forgotten: on request, and to have two sides in step."""
        if task.resets != before.resets:
            return True
        now, then = ([side.rendered for side in t.settings.shown] for t in (task, before))
        return task.settings.compare and now != then

    def _accumulates(self, task: Task) -> bool:
        settings = task.settings
        return (
            settings.accumulate
            and not settings.compare
            and not settings.frozen
            and not task.moving
            and task.rest >= SETTLED
            and VIEWS[settings.sides[0].view].still
        )

    def _live(self, task: Task) -> Published:
        """A frame of each side; the same one where they differ in nothing that is rendered."""
        settings = task.settings
        self._pace = pace.chosen(self._pace, self._sizes, settings.fps)
        size = self._sizes[self._pace.level if task.moving else 0]
        timed = self._clock() - self._timed >= BETWEEN_PLOTS
        self._timed = self._clock() if timed else self._timed
        shots: dict[tuple[object, ...], Shot] = {}
        for side in settings.shown:
            if side.rendered not in shots:
                shots[side.rendered] = self._renderer.shoot(side, task.pose, size, timed)
        seconds = sum(shot.seconds for shot in shots.values())
        if all(shot.warm for shot in shots.values()):
            self._pace = pace.measured(self._pace, size[0] * size[1], seconds)
        self._frames += 1
        self._stands = False
        before = self._shots[0].pose if self._shots else task.pose
        self._shots = tuple(
            replace(shots[side.rendered], side=side, before=before) for side in settings.shown
        )
        return self._drawn(task, self._shots)

    def _drawn(self, task: Task, shots: tuple[Shot, ...]) -> Published:
        settings = task.settings
        shots = _seen_as(settings, shots)
        reference = self._reference_of(shots[0].pose, shots[0].size)
        drawn = [_draw(shot, settings.exposure, reference) for shot in shots]
        self._plot(drawn, reference, [shot.passes for shot in shots])
        facts = {
            "state": "frozen" if settings.frozen else "moving" if task.moving else "live",
            "camera": _place(shots[0].pose),
            "frames": self._frames,
            "ms": round(1e3 * sum(shot.seconds for shot in shots), 1),
            "compiled": sum(shot.compiled for shot in shots),
        }
        return self._published(drawn, facts, reference)

    def _frozen(self, task: Task) -> Published:
        """What was shown, still or frame, as settings show it now."""
        view, resting = VIEWS[task.settings.sides[0].view], self._resting
        if self._stands and resting is not None and view.still and not task.settings.compare:
            return self._stood(task, resting)
        return self._drawn(task, self._shots)

    def _grown(self, task: Task) -> Published | None:
        """A still with one more frame; seldom shown, so that time is spent on its frames."""
        side = task.settings.sides[0]
        resting = self._resting
        if resting is None or resting.side.rendered != side.rendered:
            self._rehearse(task)
            self._announce("compiling the still")
            resting = self._resting = Resting(self._renderer, side, task.pose)
            self._announce("accumulating")
        elif resting.pose != task.pose:
            resting.restart(task.pose)
            self._announce("accumulating")
        progress = resting.advance(steered=side.view == COLOUR)
        self._finished = progress is None
        if progress is not None and not self._is_due(progress.frames, task.settings):
            return None
        return self._stood(task, resting)

    def _stood(self, task: Task, resting: Resting) -> Published:
        """A still as it is now."""
        side = task.settings.sides[0]
        self._stands = True
        still = resting.still(denoise=side.view == "denoised")
        self._rested, self._drawn_as = self._clock(), task.settings
        reference = self._reference_of(resting.pose, self._renderer.full)
        exposure = task.settings.exposure
        if side.view == "error":
            if reference is None:
                raise ValueError(VIEWS["error"].missing(side, None))
            drawn = views.error(still.image, reference)
        elif still.denoised is not None:
            drawn = views.colour(still.denoised, exposure)
        else:
            # A preview is for the eye; what is measured is the mean, as the stated error is.
            drawn = replace(views.colour(resting.shown(), exposure), image=still.image)
        self._plot([drawn], reference, self.plots.passes)
        facts = {
            "state": "frozen" if task.settings.frozen else "still",
            "camera": _place(resting.pose),
            "frames": still.frames,
            # JSON has no infinity, which a black picture's is.
            "error": round(still.error, 5) if math.isfinite(still.error) else None,
            "ms": round(1e3 * still.seconds / max(still.frames, 1), 1),
        }
        return self._published([drawn], facts, reference)

    def _is_due(self, frames: int, settings: Settings) -> bool:
        """Whether a still of so many frames is worth a picture."""
        if frames <= SHOWN_FROM:
            return frames == SHOWN_FROM
        return settings != self._drawn_as or self._clock() - self._rested >= BETWEEN_STILLS

    def _rehearse(self, task: Task) -> None:
        """Record the frames that the next touch of the camera will need, while there is time."""
        size = self._sizes[pace.chosen(self._pace, self._sizes, task.settings.fps).level]
        side = task.settings.sides[0]
        if not self._renderer.knows(side, size):
            for _ in range(RECORDED):
                self._renderer.shoot(side, task.pose, size, timed=False)

    def _keep(self, pose: Pose | None) -> None:
        """Take the still, if there is one, as the reference of its view."""
        if self._resting is None or self._resting.pose != pose:
            return
        still = self._resting.still(denoise=False)
        if still.image.any():
            self._reference = Reference(still.image, pose, f"{still.frames} frames")

    def _reference_of(self, pose: Pose | None, size: tuple[int, int]) -> Reference | None:
        for reference in (self._reference, self._given):
            if reference is not None and reference.fits(pose, size):
                return reference
        return None

    def _plot(self, drawn: list[Drawn], reference: Reference | None, passes: Any) -> None:
        now = self._clock()
        if now - self._plotted < BETWEEN_PLOTS:
            return
        self._plotted = now
        spectra, self._errors = [], []
        if reference is not None:
            for each in drawn:
                image = each.image
                relative = None if image is None else views.relative_error(image, reference)
                spectra.append([] if relative is None else spectrum(relative))
                self._errors.append(None if image is None else relmse(image, reference))
        self.plots = Plots(tuple(passes) if all(passes) else self.plots.passes, tuple(spectra))

    def _published(
        self, drawn: list[Drawn], facts: dict[str, Any], reference: Reference | None
    ) -> Published:
        quality = encode.RESTING if facts["state"] in ("still", "frozen") else encode.MOVING
        pictures = tuple(each.picture for each in drawn)
        height, width = pictures[0].shape[:2]
        facts |= {
            "width": width,
            "height": height,
            "full": list(self._renderer.full),
            "scales": [each.scale for each in drawn],
        }
        if reference is not None:
            # As of the last plots: they take as long as a small frame.
            facts |= {"relmse": self._errors, "reference": reference.name}
        return Published(
            next(self._numbers),
            pictures,
            tuple(encode.jpeg(picture, quality) for picture in pictures),
            facts,
        )


def _seen_as(settings: Settings, shots: tuple[Shot, ...]) -> tuple[Shot, ...]:
    """With the views of the moment: a frozen frame keeps all else."""
    return tuple(
        replace(shot, side=replace(shot.side, view=side.view))
        for shot, side in zip(shots, settings.sides, strict=False)
    )


def _draw(shot: Shot, exposure: float, reference: Reference | None) -> Drawn:
    view = VIEWS[shot.side.view]
    if missing := view.missing(shot.side, reference):
        raise ValueError(missing)
    return view.draw(shot, exposure, reference)


def _place(pose: Pose | None) -> list[float]:
    return [] if pose is None else [round(value, 6) for value in (*pose.origin, *pose.target)]
