"""The Georgiev-Fajardo energy of a mask or an image, and masks by simulated annealing with swaps.

Georgiev and Fajardo 2016, *Blue-noise dithered sampling*: neighbours should differ,

    E = sum_{p != q} exp(-|p - q|²/sigma_i² - |s_p - s_q|^(d/2)/sigma_s²),

with pixel distances that wrap around, and values s in [0, 1]^d. The energy presupposes a fixed set
of values: what it rewards is their arrangement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

SIGMA_I = 2.1
"""Reach in pixels."""

SIGMA_S = 1.0
"""Reach in values."""

RADIUS = 6
"""Pairs further apart are left out: their spatial factor is below exp(-(7/2.1)²) = 1.5e-5."""

# Above the first temperature the values stay mixed; below the last hardly a swap is made.
TEMPERATURES: tuple[float, ...] = tuple(np.geomspace(0.3, 0.005, 15).tolist())
SWEEPS = 24
GREEDY_SWEEPS = 60

# Swaps that gain less than single precision can tell are not made in the greedy stage.
_MARGIN = 1e-5

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Stage:
    """
    One temperature of an annealing.

    Fields
    ------
    temperature : float
        0 is the greedy stage, of which each sweep is one entry.
    energy : float
        Energy at its end.
    accepted : float
        Share of the proposed swaps that were made.
    """

    temperature: float
    energy: float
    accepted: float


def _window(size: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], FloatArray]:
    """Offsets (rows, columns) of the disc of radius `RADIUS` without its centre, and weights."""
    reach = min(RADIUS, (size - 1) // 2)
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    squared = rows**2 + columns**2
    inside = (squared > 0) & (squared <= RADIUS**2)
    weights = np.exp(-squared[inside] / SIGMA_I**2)
    return rows[inside], columns[inside], weights


def _likeness(difference: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """exp(-|difference|^(d/2)/sigma_s²) for differences of shape (..., d), which are overwritten.

    Working in place matters: fresh pages cost more than the arithmetic.
    """
    d = difference.shape[-1]
    if d == 1:
        result = np.abs(difference[..., 0], out=difference[..., 0])
        np.sqrt(result, out=result)
    else:
        result = np.einsum("...i,...i->...", difference, difference)
        np.power(result, d / 4, out=result)
    result *= -1.0 / SIGMA_S**2
    return np.exp(result, out=result)


def energy(values: npt.ArrayLike) -> float:
    """
    Energy of a square mask over ordered pairs at most `RADIUS` pixels apart, toroidal.

    Parameters
    ----------
    values : array_like, (n, n) or (n, n, d)
        In [0, 1].
    """
    s = np.asarray(values, dtype=np.float64)
    s = s[..., None] if s.ndim == 2 else s
    total = 0.0
    for row, column, weight in zip(*_window(len(s)), strict=True):
        # Each unordered pair once, counted twice.
        if (row, column) > (0, 0):
            shifted = np.roll(s, (-row, -column), (0, 1))
            total += 2.0 * float(weight) * float(_likeness(s - shifted).sum())
    return total


def image_energy(values: npt.ArrayLike) -> FloatArray:
    """
    Energy of every pixel of an image among its neighbours; what lies outside does not count.

    Parameters
    ----------
    values : array_like, (h, w)
        In [0, 1].

    Returns
    -------
    array, (h, w)
        sum_q exp(-|p - q|²/sigma_i² - |s_p - s_q|^(1/2)/sigma_s²) over the other pixels q within
        `RADIUS`; their sum is the energy of the image over ordered pairs.
    """
    s = np.asarray(values, dtype=np.float64)
    padded = np.pad(s, RADIUS, constant_values=np.nan)
    total = np.zeros_like(s)
    for row, column, weight in zip(*_window(2 * RADIUS + 1), strict=True):
        there = padded[RADIUS + row :, RADIUS + column :][: s.shape[0], : s.shape[1]]
        total += float(weight) * np.nan_to_num(_likeness((s - there)[..., None]))
    return total


def anneal(
    values: npt.ArrayLike,
    seed: int,
    temperatures: Sequence[float] = TEMPERATURES,
    sweeps: int = SWEEPS,
    greedy_sweeps: int = GREEDY_SWEEPS,
) -> tuple[npt.NDArray[np.intp], list[Stage]]:
    """
    Rearrange values by swaps so that their energy is low.

    Many swaps are tried at a time, on pixels so far apart that no swap changes another's energy
    difference: the result is that of trying them one after the other.

    Parameters
    ----------
    values : array_like, (n, n) or (n, n, d)
        In [0, 1], n at least 14.
    seed : int
        Of the proposals and acceptances.
    temperatures : sequence of float
        Falling. A swap that raises the energy by dE is made with probability exp(-dE/temperature).
    sweeps, greedy_sweeps : int
        Sweeps at each temperature and at temperature 0; in a sweep every pixel is tried about once.

    Returns
    -------
    array of int, (n, n)
        Where each pixel's value comes from: ``values.reshape(n * n, -1)[result]``.
    list of Stage
    """
    start = np.asarray(values, dtype=np.float64)
    n = len(start)
    if n < 2 * (RADIUS + 1):
        raise ValueError(f"Annealing needs at least {2 * (RADIUS + 1)} pixels a side, not {n}.")
    start = start.reshape(n * n, -1)
    swapper = _Swapper(start, n, np.random.default_rng(seed))

    def stage(temperature: float, count: int) -> Stage:
        accepted = float(np.mean([swapper.sweep(temperature) for _ in range(count)]))
        return Stage(float(temperature), energy(start[swapper.source].reshape(n, n, -1)), accepted)

    stages = [stage(temperature, sweeps) for temperature in temperatures]
    stages += [stage(0.0, 1) for _ in range(greedy_sweeps)]
    return swapper.source.reshape(n, n), stages


class _Swapper:
    """The state of an annealing: which value sits where."""

    def __init__(self, values: FloatArray, size: int, rng: np.random.Generator) -> None:
        self.size, self.rng = size, rng
        self.values = values.astype(np.float32)
        self.source = np.arange(size * size)
        rows, columns, weights = _window(size)
        self.weights = weights.astype(np.float32)
        self.padded_size = size + 2 * RADIUS
        self.around = (rows + RADIUS) * self.padded_size + columns + RADIUS

    def sweep(self, temperature: float) -> float:
        """Try about as many swaps as reach every pixel once; return the share that was made."""
        cells = self.size // (RADIUS + 1)
        made = tried = 0
        for _ in range(-(-self.size * self.size // (cells * cells))):
            made += self._try_swaps(self._distant_pixels(cells), temperature)
            tried += cells * cells // 2
        return made / tried

    def _distant_pixels(self, cells: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """
        Rows and columns of cells² pixels, any two more than `RADIUS` apart, in random order.

        Lines of equally spaced pixels, each line shifted at random along itself: were they not,
        a value could never leave its residue class.
        """
        spaced = np.arange(cells) * self.size // cells
        lines = spaced + self.rng.integers(self.size)
        along = spaced + self.rng.integers(self.size, size=(cells, 1))
        order = self.rng.permutation(cells * cells)
        a = np.repeat(lines % self.size, cells)[order]
        b = (along % self.size).ravel()[order]
        return (a, b) if self.rng.random() < 0.5 else (b, a)

    def _try_swaps(
        self, pixels: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]], temperature: float
    ) -> int:
        here, change = self._changes(pixels)
        half = len(change)
        chosen = change < -_MARGIN
        if temperature > 0.0:
            chance = np.exp(-np.maximum(change, 0.0) / temperature)
            chosen = self.rng.random(half) < chance
        first, second = here[:half][chosen], here[half:][chosen]
        for array in (self.values, self.source):
            array[first], array[second] = array[second], array[first]
        return int(chosen.sum())

    def _changes(
        self, pixels: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.float64]]:
        """Pixels, and what the swap of the i-th of each half changes the energy by."""
        row, column = pixels
        half = len(row) // 2
        here = (row * self.size + column)[: 2 * half]
        centres = (row * self.padded_size + column)[: 2 * half]
        # Padding the whole mask costs less than wrapping every neighbour's coordinates.
        mask = self.values.reshape(self.size, self.size, -1)
        padded = np.pad(mask, ((RADIUS, RADIUS), (RADIUS, RADIUS), (0, 0)), mode="wrap")
        around = centres[:, None] + self.around
        neighbours = padded.reshape(-1, mask.shape[2]).take(around, axis=0)
        own = self.values[here]
        other = np.roll(own, half, axis=0)
        before = _likeness(neighbours - own[:, None]) @ self.weights
        after = _likeness(neighbours - other[:, None]) @ self.weights
        # Both pixels' terms, and each pair is in the energy in both orders.
        return here, 2.0 * (after - before).reshape(2, half).sum(axis=0)
