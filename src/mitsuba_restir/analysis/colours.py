"""Colours of figures: one for each variant, and maps of numbers to colours."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

Picture = npt.NDArray[np.uint8]

# Told apart by most who see few colours, and on white paper; the first is the baseline's grey.
_LINES = (
    "#4c566a", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c564b",
    "#6a3d9a", "#b8a800", "#1b9e77", "#e7298a", "#7f7f7f", "#17becf", "#a6761d", "#3b3b98",
)  # fmt: skip

# Anchors of two perceptually ordered maps: dark to bright, and blue over white to red.
_SEQUENTIAL = np.array(
    [[4, 4, 20], [66, 15, 117], [147, 38, 103], [221, 81, 58], [252, 165, 10], [252, 255, 164]]
)
_DIVERGING = np.array(
    [[5, 48, 97], [67, 147, 195], [209, 229, 240], [255, 255, 255], [253, 219, 199],
     [214, 96, 77], [103, 0, 31]]
)  # fmt: skip
# An even number: zero is a level of its own, and a picture has few enough colours for a palette.
_STEPS = 254


def line_colours(names: Iterable[str]) -> dict[str, str]:
    """Give every variant a colour, the same in all figures of a report."""
    return {name: _LINES[index % len(_LINES)] for index, name in enumerate(names)}


def diverging(values: npt.ArrayLike) -> Picture:
    """Colour values from -1 (blue) over 0 (white) to 1 (red): (H, W) to (H, W, 3)."""
    return _colour(0.5 * (np.asarray(values, dtype=np.float64) + 1.0), 0.5, _DIVERGING)


def sequential(values: npt.ArrayLike) -> Picture:
    """Colour values from 0 (dark) to 1 (bright): (H, W) to (H, W, 3)."""
    return _colour(np.asarray(values, dtype=np.float64), 0.0, _SEQUENTIAL)


def _colour(
    values: npt.NDArray[np.float64], unknown: float, anchors: npt.NDArray[np.int64]
) -> Picture:
    x = np.clip(np.nan_to_num(values, nan=unknown), 0.0, 1.0)
    x = np.round(x * _STEPS) / _STEPS
    places = np.linspace(0.0, 1.0, len(anchors))
    channels = [np.interp(x, places, anchors[:, c]) for c in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8)
