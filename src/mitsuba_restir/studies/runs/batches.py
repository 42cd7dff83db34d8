"""The mean of independent batches of a reference, and how sure it is."""

from __future__ import annotations

import numpy as np

from .results import Image, ReferenceImage

LEAST_BATCHES = 8
"""From fewer, a variance cannot be told."""


class BatchMean:
    """
    Mean of batches of samples, weighted by their samples.

    The variance of a sample is that of the means of n samples about the mean of all, times n.

    Parameters
    ----------
    size : (int, int)
        Width and height in pixels.

    Fields
    ------
    count, samples : int
        Batches and samples per pixel taken so far.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.count = self.samples = 0
        self._sum, self._squares = np.zeros((2, size[1], size[0], 3))

    def add(self, batch: Image, samples: int) -> None:
        """Take the next batch, (H, W, 3)."""
        values = batch.astype(np.float64)
        self.count += 1
        self.samples += samples
        self._sum += samples * values
        self._squares += samples * values**2

    def image(self) -> ReferenceImage:
        """Return the mean and its variance."""
        mean = self._sum / self.samples
        spread = np.maximum(self._squares / self.samples - mean**2, 0.0)
        return ReferenceImage(mean, spread / max(self.count - 1, 1), samples=self.samples)
