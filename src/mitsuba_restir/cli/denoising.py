"""Whether the denoiser is there: Intel Open Image Denoise, an optional dependency."""

from __future__ import annotations

from ..analysis.denoise import installed
from ..errors import UsageError

PRESET = "denoised"
"""Preset of the frames that are denoised, where none is asked for."""


def require() -> None:
    """
    Make sure that the denoiser is installed.

    Raises
    ------
    UsageError
        It is not; says how to install it.
    """
    if not installed():
        raise UsageError("argument --denoise: needs pip install 'mitsuba-restir[denoise]'")
