"""Void-and-cluster masks (Ulichney 1993): every threshold of the mask is an even point pattern.

Points are taken from the tightest cluster or put into the largest void of a binary pattern, by the
pattern filtered with a Gaussian; a point's rank is its turn.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

SIGMA = 1.5
"""Width of the Gaussian in pixels (Ulichney's choice)."""

_RADIUS = 12  # where the Gaussian ends, at 1e-14
_TIES = 1e-12
_INITIAL_SHARE = 0.1

Ranks = npt.NDArray[np.uint32]
FloatArray = npt.NDArray[np.float64]
Pixel = tuple[int, int]


class _Field:
    """A toroidal field to which Gaussians are added, with its smallest value at hand.

    The smallest value of each row is kept, so that a change costs a few rows and not the mask.
    """

    def __init__(self, values: FloatArray) -> None:
        self.values = values
        self.lowest = values.min(axis=1)
        reach = min(_RADIUS, (len(values) - 1) // 2)
        self.steps = np.arange(-reach, reach + 1)
        line = np.exp(-(self.steps**2) / (2.0 * SIGMA**2))
        self.kernel = np.outer(line, line)

    def add(self, point: Pixel, sign: float, own: float) -> None:
        """Add a Gaussian times ``sign`` around a pixel, whose own value becomes ``own``."""
        n = len(self.values)
        row, column = point
        rows = (row + self.steps) % n
        self.values[rows[:, None], (column + self.steps) % n] += sign * self.kernel
        self.values[point] = own
        self.lowest[rows] = self.values[rows].min(axis=1)

    def argmin(self) -> Pixel:
        row = int(self.lowest.argmin())
        return row, int(self.values[row].argmin())


def void_and_cluster(size: int, seed: int) -> Ranks:
    """
    Make a void-and-cluster mask.

    Parameters
    ----------
    size : int
        Side n in pixels.
    seed : int
        Of the initial pattern.

    Returns
    -------
    array, (n, n), uint32
        Each rank from 0 to n² - 1 once.
    """
    rng = np.random.default_rng(seed)
    count = size * size
    # Points out of each other's reach tie; without noise they would go in reading order.
    voids = _Field(_TIES * rng.random((size, size)))
    clusters = _Field(np.full((size, size), np.inf))
    initial = max(1, int(_INITIAL_SHARE * count))
    for index in rng.permutation(count)[:initial]:
        _put(divmod(int(index), size), voids, clusters)
    _spread(voids, clusters)

    ranks = np.empty((size, size), dtype=np.uint32)
    for rank in range(initial - 1, -1, -1):
        point = clusters.argmin()
        ranks[point] = rank
        clusters.add(point, 1.0, np.inf)
    # Beyond half of the pixels the zeros are the minority, and Ulichney takes the tightest cluster
    # of them; it is where the field of the ones is lowest, so that one rule serves both phases.
    for rank in range(initial, count):
        point = voids.argmin()
        ranks[point] = rank
        voids.add(point, 1.0, np.inf)
    return ranks


# Of one filtered pattern F, `voids` holds F where there is no point and `clusters` -F where there
# is one; elsewhere they are infinite, so that the minimum of each is what its name says.


def _put(point: Pixel, voids: _Field, clusters: _Field) -> None:
    value = voids.values[point] + 1.0
    voids.add(point, 1.0, np.inf)
    clusters.add(point, -1.0, -value)


def _take(point: Pixel, voids: _Field, clusters: _Field) -> None:
    value = -clusters.values[point] - 1.0
    clusters.add(point, 1.0, np.inf)
    voids.add(point, -1.0, value)


def _spread(voids: _Field, clusters: _Field) -> None:
    """Move points from the tightest cluster to the largest void until that is where they were."""
    while True:
        cluster = clusters.argmin()
        _take(cluster, voids, clusters)
        void = voids.argmin()
        _put(void, voids, clusters)
        if cluster == void:
            return
