"""What goes from pages to the worker, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .camera import Pose
from .encode import Picture
from .model import Settings


@dataclass(frozen=True)
class Task:
    """
    What the worker is to do next.

    Attributes
    ----------
    settings : Settings
    pose : Pose or None
    resets, steps, kept : int
        How often histories were to be forgotten, single frames were asked for, and the picture was
        to be kept as the reference, so far.
    rest : float
        Seconds since the camera moved, or what is rendered changed.
    moving : bool
    """

    settings: Settings
    pose: Pose | None
    resets: int
    steps: int
    kept: int
    rest: float
    moving: bool


@dataclass(frozen=True)
class Published:
    """
    A picture as browsers get it.

    Attributes
    ----------
    number : int
        It grows from picture to picture.
    pictures : tuple of arrays, (H, W, 3)
        Of A, and of B where they are compared.
    parts : tuple of bytes
        The same as JPEG.
    facts : mapping
        What is said beside them.
    """

    number: int
    pictures: tuple[Picture, ...]
    parts: tuple[bytes, ...]
    facts: Mapping[str, Any]


@dataclass(frozen=True)
class Plots:
    """
    What is plotted.

    Attributes
    ----------
    passes : sequence of mappings of str to float
        Milliseconds by pass, of each side.
    spectra : sequence of lists of (float, float)
        Power by frequency, of each side; none where there is no reference.
    """

    passes: Sequence[Mapping[str, float]] = ()
    spectra: Sequence[list[tuple[float, float]]] = ()
