"""Pictures for the browser."""

from __future__ import annotations

import io

import numpy as np
import numpy.typing as npt
from PIL import Image

Picture = npt.NDArray[np.uint8]
"""8-bit sRGB, (H, W, 3)."""

MOVING, RESTING = 85, 95
"""Qualities of JPEG: of frames that are soon replaced, and of a picture that is looked at."""


def jpeg(picture: Picture, quality: int = MOVING) -> bytes:
    """Encode as JPEG without subsampling of colours: noise is colourful."""
    return _encoded(picture, "JPEG", quality=quality, subsampling=0)


def png(picture: Picture) -> bytes:
    """Encode as PNG."""
    return _encoded(picture, "PNG")


def split(a: Picture, b: Picture, divider: float) -> Picture:
    """A to the left of the divider (0 to 1 of the width), B to the right of it."""
    column = round(divider * a.shape[1])
    return np.concatenate([a[:, :column], b[:, column:]], axis=1)


def _encoded(picture: Picture, kind: str, **options: int) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, kind, **options)
    return stream.getvalue()
