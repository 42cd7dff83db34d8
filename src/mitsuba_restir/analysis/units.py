"""Units of a statistical test: runs averaged into batches, pixels averaged into blocks."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from .images import FloatArray


def batch_means(runs: Iterable[ArrayLike], size: int) -> FloatArray:
    """
    Average every `size` consecutive runs, without holding all of them.

    Parameters
    ----------
    runs : iterable of array_like
        Independent images of one shape; a generator is consumed one image at a time.
    size : int
        Runs in a batch.

    Returns
    -------
    ndarray, (B, ...)
        The batch means.

    Raises
    ------
    ValueError
        If the number of runs is no multiple of `size`.
    """
    if size < 1:
        raise ValueError(f"A batch needs at least one run, not {size}.")
    batches: list[FloatArray] = []
    count = 0
    for run in runs:
        image = np.asarray(run, dtype=np.float64)
        if count % size == 0:
            batches.append(np.zeros_like(image))
        batches[-1] += image / size
        count += 1
    if count == 0 or count % size:
        raise ValueError(f"{count} runs cannot be averaged into batches of {size}.")
    return np.stack(batches)


def block_sums(image: FloatArray, block: int | None) -> tuple[FloatArray, FloatArray]:
    """
    Sums over blocks of pixels; the last row and column of blocks may be smaller.

    Parameters
    ----------
    image : ndarray, (..., H, W, C)
    block : int or None
        Side in pixels; None is the whole image.

    Returns
    -------
    sums : ndarray, (..., h, w, C)
    counts : ndarray, (h, w, 1)
        Pixels in each block.
    """
    height, width = image.shape[-3:-1]
    step = max(height, width) if block is None else block
    rows, columns = np.arange(0, height, step), np.arange(0, width, step)
    sums = np.add.reduceat(np.add.reduceat(image, rows, axis=-3), columns, axis=-2)
    counts = np.outer(np.diff([*rows, height]), np.diff([*columns, width]))
    return sums, counts[..., None].astype(np.float64)
