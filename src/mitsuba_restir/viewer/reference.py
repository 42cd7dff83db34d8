"""What frames are compared with, and what their error is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..analysis.images import FloatArray, luminance, smoothed_reference
from ..analysis.metrics import trimmed_relmse
from ..analysis.spectrum import power_spectrum, radial_spectrum
from ..imageio import Image
from .camera import Pose

CLIP = 4.0
"""Relative errors of a spectrum are clipped to this: fireflies are white, and hide the rest."""


@dataclass(frozen=True)
class Reference:
    """
    A picture that counts as the truth.

    Attributes
    ----------
    image : array, (H, W, 3)
    pose : Pose or None
        What it is of.
    name : str
        Where it comes from.
    """

    image: Image
    pose: Pose | None
    name: str

    @cached_property
    def luminance(self) -> FloatArray:
        """Of its pixels, (H, W)."""
        return luminance(self.image)

    @cached_property
    def scale(self) -> FloatArray:
        """What errors are relative to, (H, W)."""
        return smoothed_reference(self.image)

    def fits(self, pose: Pose | None, size: tuple[int, int]) -> bool:
        """Whether it is of this view, and as large."""
        return pose == self.pose and size == (self.image.shape[1], self.image.shape[0])


def spectrum(relative: FloatArray) -> list[tuple[float, float]]:
    """Power of a relative error by frequency [cycles/pixel], in rings."""
    rings = radial_spectrum(power_spectrum(np.clip(relative, -CLIP, CLIP)))
    return [(float(f), float(p)) for f, p in zip(rings.frequency, rings.power, strict=True)]


def relmse(image: Image, reference: Reference) -> float:
    """Relative squared error, without the worst 0.1 % of the pixels, in three digits."""
    found = trimmed_relmse(np.nan_to_num(image, posinf=0.0, neginf=0.0), reference.image)
    return float(f"{found:.3g}")
