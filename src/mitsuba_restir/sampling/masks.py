"""Blue-noise and white masks by name, made once and then read from the user's cache."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .. import cache as kept
from ..errors import RenderError
from ..imageio import write_atomically
from . import georgiev
from .void_cluster import Ranks, void_and_cluster

SIZE = 256
"""Default side in pixels: smaller tiles leave combs in an image's spectrum."""

MIN_SIZE = 2 * (georgiev.RADIUS + 1)
MAX_SIZE = 4096

# Part of the files' names: raise it when a generator's result changes.
_VERSION = 1


def white(size: int, seed: int) -> Ranks:
    """Make a white mask: the ranks 0 ... size² - 1 in random order, (size, size)."""
    order = np.random.default_rng(seed).permutation(size * size)
    return order.astype(np.uint32).reshape(size, size)


def annealing(size: int, seed: int) -> Ranks:
    """Make a blue-noise mask by annealing a white one's Georgiev-Fajardo energy, (size, size)."""
    start = white(size, seed)
    source, _ = georgiev.anneal(mask_values(start), seed)
    return start.ravel()[source]


KINDS: dict[str, Callable[[int, int], Ranks]] = {
    "void_and_cluster": void_and_cluster,
    "annealing": annealing,
    "white": white,
}
"""Generators by name: functions of (size, seed)."""


def mask_values(ranks: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Turn ranks 0 ... N - 1 into values (rank + 1/2) / N in (0, 1), N the number of pixels."""
    r = np.asarray(ranks)
    return (r + 0.5) / r.size


def load_mask(
    kind: str = "void_and_cluster", size: int = SIZE, seed: int = 0, cache: Path | None = None
) -> Ranks:
    """
    Return a mask, from the cache if it has been made before.

    Parameters
    ----------
    kind : str
        A name in `KINDS`.
    size : int
        Side n in pixels, 14 to 4096.
    seed : int
        Of the generator.
    cache : Path, optional
        Folder of the cache, by default one in the user's own cache directory, or in the folder that
        the environment variable `MITSUBA_RESTIR_CACHE` names. A file in it that is damaged is made
        anew; a folder that cannot be written costs a warning.

    Returns
    -------
    array, (n, n), uint32
        Each rank from 0 to n² - 1 once.
    """
    if kind not in KINDS:
        raise ValueError(f"A mask's kind is one of {', '.join(KINDS)}, not '{kind}'.")
    if not MIN_SIZE <= size <= MAX_SIZE:
        raise ValueError(f"A mask's side is {MIN_SIZE} to {MAX_SIZE} pixels, not {size}.")
    if kind == "white":  # made faster than read
        return white(size, seed)
    folder = cache_folder() if cache is None else cache
    path = folder / f"{kind}-{size}-{seed}-v{_VERSION}.npy"
    ranks = _read(path, size)
    if ranks is None:
        ranks = KINDS[kind](size, seed)
        _write(path, ranks)
    return ranks


def cache_folder() -> Path:
    """Folder in which masks are kept unless told otherwise."""
    return kept.cache_folder("masks")


def _read(path: Path, size: int) -> Ranks | None:
    """Read a cached mask; None if it is not there or is not a permutation of the ranks."""
    try:
        ranks = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None
    if ranks.shape != (size, size) or ranks.dtype != np.uint32 or ranks.max() >= ranks.size:
        return None
    complete = bool((np.bincount(ranks.ravel(), minlength=ranks.size) == 1).all())
    return ranks if complete else None


def _write(path: Path, ranks: Ranks) -> None:
    data = io.BytesIO()
    np.save(data, ranks)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, data.getvalue())
    except (OSError, RenderError) as error:
        warnings.warn(f"the mask is not kept for the next time: {error}", stacklevel=3)
