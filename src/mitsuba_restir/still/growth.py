"""A still that grows frame by frame, and what it is at any moment."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from ..analysis.denoise import denoise_guided
from ..imageio import Image
from ..integrators.state import State
from . import accumulate
from .accumulate import Layout, Size, Sums
from .error import UNKNOWN, Stated, stated
from .goal import DARK, LEAST, Goal, decides, next_decision
from .mix import mixture
from .picture import Progress, Still
from .plan import Plan
from .preview import Added, Estimated, Preview


class Source(Protocol):
    """Where frames come from: see :class:`.frames.Frames`."""

    plan: Plan
    size: Size
    lit: bool
    layout: Layout
    images: dict[str, slice]
    guides: list[slice]

    def render(self) -> mi.Float:
        """The next frame's film."""

    def state(self) -> State:
        """What later frames depend on."""

    def preview(self) -> Preview | None:
        """What is to be shown of a still of these frames, where that is not its mean."""

    def estimated(self) -> Estimated:
        """What a preview chooses from, of the last frame."""


@dataclass(frozen=True)
class Snapshot:
    """
    All that the rest of a still depends on, between two frames.

    Attributes
    ----------
    frames : int
    sums : Sums
    weights : list of Float
        Of the next frame's estimates.
    known : Stated
        The error, as of the last decision.
    decided : int
        Number of the frames then.
    state : State or None
        Of what renders the frames; None before the first.
    """

    frames: int
    sums: Sums
    weights: list[mi.Float]
    known: Stated = UNKNOWN
    decided: int = 0
    state: State | None = None


def nothing(source: Source) -> Snapshot:
    """The snapshot before the first frame."""
    layout, size = source.layout, source.size
    return Snapshot(0, accumulate.nothing(layout, size), accumulate.own_colour(layout, size))


class Growth:
    """
    A still that is being rendered.

    Parameters
    ----------
    source : Source
    why : str
        Why the plan was chosen.
    elapsed : callable
        Seconds that the still has taken so far.
    snapshot : Snapshot, optional
        Where it goes on from; the source must have taken up the state in it.

    Attributes
    ----------
    snapshot : Snapshot
        What it is now. Replaced as a whole after each frame, so that an interrupt at any moment
        leaves a whole one.
    """

    def __init__(
        self,
        source: Source,
        why: str,
        elapsed: Callable[[], float],
        snapshot: Snapshot | None = None,
    ) -> None:
        self.source = source
        self.why = why
        self.elapsed = elapsed
        self.snapshot = snapshot or nothing(source)
        self._preview = source.preview()

    def steer(self, wanted: bool) -> None:
        """From the next frame on, have what is shown steered where that is possible, or no longer.

        It takes time, and is wanted to begin with. A new preview begins with the mean.
        """
        if not wanted:
            self._preview = None
        elif self._preview is None:
            self._preview = self.source.preview()

    def grow(self, goal: Goal) -> Iterator[Progress]:
        """
        Render frames until the goal is reached.

        No frame is begun that would, at the pace of the last one, end after the time is up.

        Yields
        ------
        Progress
            After each frame.
        """
        pace = 0.0
        while self.source.lit and not self._reached(goal, pace):
            begin = self.elapsed()
            self.snapshot = self._next()
            pace = self.elapsed() - begin
            yield self._progress(goal, pace)

    @property
    def has_picture(self) -> bool:
        """Whether there is a frame, or none is needed, since the picture is black."""
        return bool(self.snapshot.frames) or not self.source.lit

    def picture(self) -> Image:
        """The mean of the frames so far, (H, W, 3)."""
        return accumulate.image_of(self.snapshot.sums.picture.mean, self.source.size)

    def shown(self) -> Image:
        """What is to be seen of it so far, (H, W, 3): a preview where one is wanted."""
        if self._preview is None:
            return self.picture()
        return self._preview.picture(self.snapshot.sums)

    def still(self, denoise: bool = False) -> Still:
        """The picture as it is now."""
        snapshot, source = self.snapshot, self.source
        frames = snapshot.frames
        image = self.picture()
        deviation = accumulate.standard_error(snapshot.sums, source.size, max(frames, 1))
        if not source.lit:
            deviation, known = np.zeros_like(image), Stated(0.0, 0.0)
        else:
            known = stated(image, deviation)
        extra = snapshot.sums.extra
        aovs = {
            name: accumulate.image_of(extra[place], source.size)
            for name, place in source.images.items()
        }
        clean = None
        if denoise:
            guides = [accumulate.image_of(extra[place], source.size) for place in source.guides]
            clean = denoise_guided(image, *guides)
        return Still(
            image,
            deviation,
            known.error,
            known.untrimmed,
            frames,
            self.elapsed(),
            source.plan,
            self.why,
            clean,
            aovs,
            _remark(source.lit, image, known),
        )

    def _next(self) -> Snapshot:
        """With one more frame; what is decided from it concerns later frames only."""
        now, source = self.snapshot, self.source
        frames = now.frames + 1
        image, count = source.render(), dr.opaque(mi.Float, frames)
        sums = accumulate.add(source.layout, now.sums, now.weights, image, count)
        if self._preview is not None:
            moments, before = sums.picture, now.sums.picture.mean
            added = Added(image, now.weights, moments.mean, moments.products, count)
            self._preview.add(source.estimated(), added, before)
        dr.sync_thread()
        weights, known, decided = now.weights, now.known, now.decided
        if decides(frames):
            size = source.size
            known, decided = self._stated(sums, frames), frames
            if weights:
                table = _weights(accumulate.covariance(sums, size, frames), frames)
                weights = [mi.Float(row.ravel()) for row in table]
        return Snapshot(frames, sums, weights, known, decided, source.state())

    def _stated(self, sums: Sums, frames: int) -> Stated:
        size = self.source.size
        image = accumulate.image_of(sums.picture.mean, size)
        return stated(image, accumulate.standard_error(sums, size, frames))

    def _reached(self, goal: Goal, pace: float) -> bool:
        now = self.snapshot
        if goal.frames is not None:
            return now.frames >= goal.frames
        if now.frames < LEAST:
            return False
        if goal.seconds is not None:
            return self.elapsed() + pace > goal.seconds
        assert goal.error is not None
        if now.decided != now.frames:
            return False
        return now.known.error <= goal.error or (now.frames >= DARK and self._dark())

    def _dark(self) -> bool:
        return all(not dr.any(mean != 0)[0] for mean in self.snapshot.sums.picture.mean)

    def _progress(self, goal: Goal, pace: float) -> Progress:
        now, seconds = self.snapshot, self.elapsed()
        since = math.sqrt(now.decided / now.frames)
        error = now.known.error * since if now.decided else math.inf
        untrimmed = now.known.untrimmed * since if now.decided else math.inf
        left: float | None = None
        if goal.seconds is not None:
            left = max(goal.seconds - seconds, 0.0)
        elif goal.frames is not None:
            left = (goal.frames - now.frames) * pace
        elif goal.error is not None:
            ratio = now.known.error / goal.error
            needed = now.decided * ratio * ratio
            if math.isfinite(needed):
                # It may stop at this decision, or at one to come.
                left = (next_decision(max(needed, now.frames)) - now.frames) * pace
        return Progress(now.frames, error, untrimmed, seconds, left)


def _weights(covariance: npt.NDArray[np.float64], frames: int) -> Image:
    """Weights for later frames, (K, H, W).

    Pixels of which a value was not finite show their frames' own colour, and keep to themselves.
    """
    lost = ~np.isfinite(covariance).all(axis=(0, 1))
    weights = mixture(np.where(lost, 0.0, covariance), frames)
    weights[:, lost] = 0.0
    weights[-1, lost] = 1.0
    return weights.astype(np.float32)


def _remark(lit: bool, image: Image, known: Stated) -> str:
    if not lit:
        return "there is no light in the scene: the picture is black"
    if not image.any():
        return "no light was found: the picture is black"
    if known.not_finite:
        lost = "1 pixel is" if known.not_finite == 1 else f"{known.not_finite} pixels are"
        return f"{lost} not finite, and not in the stated error"
    return ""
