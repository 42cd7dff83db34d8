"""Images as a frame's arrays have them, pixel by pixel of the grid, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from mitsuba_restir.paths.grid import grid_of


def order(width: int, height: int) -> np.ndarray:
    """Index of every pixel, (height, width)."""
    return np.array(grid_of(width, height).by_rows()).reshape(height, width)


def lanes_of(image: Any) -> np.ndarray:
    """The (..., height, width) image as the (..., pixels) values of the grid."""
    image = np.asarray(image)
    *rest, height, width = image.shape
    lanes = np.empty((*rest, height * width), image.dtype)
    lanes[..., order(width, height)] = image
    return lanes


def image_of(lanes: Any, width: int, height: int) -> np.ndarray:
    """The (..., pixels) values of the grid as a (..., height, width) image."""
    return grid_of(width, height).image(np.array(lanes))
