"""Duplicated paths: pixels whose path another pixel nearby has too.

Resampling spreads one path over many pixels, and each of its copies carries the same error. The
statistic counts paths by identity, so that a mutated copy is no duplicate (a map by random seeds,
as in Lin, Kettunen and Wyman 2026, would still count it).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["copies", "duplicated_share"]

NO_PATH = -1
"""Identity of a pixel without a path."""


def copies(identities: ArrayLike, radius: int = 8) -> NDArray[np.int64]:
    """
    Count in every pixel the others of its neighbourhood that have the same path.

    Parameters
    ----------
    identities : array_like of int, (H, W)
        Equal where the paths are equal; `NO_PATH` where there is none, which equals nothing.
    radius : int
        The neighbourhood is the window of (2 radius + 1)² pixels around a pixel, cut off at the
        image's border, without the pixel itself.

    Returns
    -------
    ndarray of int, (H, W)

    Raises
    ------
    ValueError
        If the array is not two-dimensional and of integers, or the radius is not positive.
    """
    ids = np.asarray(identities)
    if ids.ndim != 2 or not np.issubdtype(ids.dtype, np.integer):
        raise ValueError(
            f"The identities have shape {ids.shape} and type {ids.dtype}: a two-dimensional array "
            "of integers is needed."
        )
    if radius < 1:
        raise ValueError(f"The radius is {radius}: it must be at least 1.")
    count = np.zeros(ids.shape, dtype=np.int64)
    for here, there in _pairs(ids.shape, radius):
        equal = (ids[here] == ids[there]) & (ids[here] != NO_PATH)
        count[here] += equal
        count[there] += equal
    return count


def duplicated_share(identities: ArrayLike, radius: int = 8) -> float:
    """
    Share of the pixels with a path whose path occurs again in their neighbourhood.

    Parameters
    ----------
    identities, radius
        See `copies`.

    Returns
    -------
    float
        From 0 to 1; 0 where no pixel has a path.
    """
    found = copies(identities, radius)
    paths = np.asarray(identities) != NO_PATH
    return float((found[paths] > 0).mean()) if paths.any() else 0.0


def _pairs(
    shape: tuple[int, ...], radius: int
) -> Iterator[tuple[tuple[slice, slice], tuple[slice, slice]]]:
    """Views of an image and of itself moved, once for each half of the window's offsets."""
    height, width = shape
    for down in range(min(radius, height - 1) + 1):
        for right in range(-min(radius, width - 1), min(radius, width - 1) + 1):
            if down == 0 and right <= 0:
                continue
            left, moved = slice(0, width - abs(right)), slice(abs(right), width)
            columns = (left, moved) if right >= 0 else (moved, left)
            yield (
                (slice(0, height - down), columns[0]),
                (slice(down, height), columns[1]),
            )
