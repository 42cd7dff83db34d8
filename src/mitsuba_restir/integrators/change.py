"""An edit of the scene between two frames, as the integrator is told of it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

from ..paths.moves import Moves


@dataclass(frozen=True)
class Change:
    """What has been edited since the last frame, and how to look back.

    Attributes
    ----------
    moves : Moves
        How the shapes have moved, on the device.
    undone : callable
        Makes a context in which the scene is what it was in the last frame.
    """

    moves: Moves
    undone: Callable[[], AbstractContextManager[None]]
