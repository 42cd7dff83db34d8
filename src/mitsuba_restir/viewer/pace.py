"""How many pixels a frame may have while something moves, so that the frame rate is held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

SCALES = (1.0, 0.75, 0.55, 0.4, 0.3, 0.2)
"""Sides of the pictures while something moves, relative to the full ones. Few, because frames are
recorded anew for each."""

SMALLEST = 16
"""Pixels that a side keeps."""

SLACK = 0.85
"""Share of a frame's time that more pixels must fit into: they would be given back at once."""

NEWEST = 0.3
"""Weight of the newest frame in the mean."""


@dataclass(frozen=True)
class Pace:
    """
    What a frame costs, and the level that followed from it.

    Attributes
    ----------
    cost : float
        Seconds a pixel; 0 before the first frame.
    level : int
        Index into :data:`SCALES`.
    """

    cost: float = 0.0
    level: int = 0


def size_at(full: tuple[int, int], level: int) -> tuple[int, int]:
    """Width and height at a level, of a picture that has others in full."""
    width, height = (min(side, max(SMALLEST, round(side * SCALES[level]))) for side in full)
    return width, height


def measured(pace: Pace, pixels: int, seconds: float) -> Pace:
    """With what one more frame has cost."""
    cost = seconds / pixels
    weight = NEWEST if pace.cost else 1.0
    return replace(pace, cost=pace.cost + weight * (cost - pace.cost))


def chosen(pace: Pace, sizes: Sequence[tuple[int, int]], fps: float) -> Pace:
    """
    With the level of the next frame: the finest that holds the frame rate, or the coarsest.

    Parameters
    ----------
    sizes : sequence of (int, int)
        Width and height at each level.
    fps : float
        Frames a second; 0 asks for all pixels.
    """
    if fps <= 0 or pace.cost == 0:
        return replace(pace, level=0)
    for level, (width, height) in enumerate(sizes):
        share = SLACK if level < pace.level else 1.0
        if pace.cost * width * height <= share / fps:
            return replace(pace, level=level)
    return replace(pace, level=len(sizes) - 1)
