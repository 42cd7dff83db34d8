"""Large frames of random seeds, with all reuse: how many of their pixels are not finite?"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import mitsuba as mi
from support.finite import not_finite, poisoned

from .generator import combination

SIDE = 512
FRAMES = 40
"""Of a scene; the first of them has no history."""

ALL_REUSE = {"temporal": True, "spatial": True, "mutations": 1, "mutation_interval": 1, "aovs": ""}


@dataclass(frozen=True)
class Count:
    """What a seed's frames held.

    Fields: ``seed``, ``pixels`` (rendered), ``bad`` (not finite), ``history`` (values of histories
    that were not finite), ``refused`` (values that ``statistics()`` counted as not finite).
    """

    seed: int
    pixels: int
    bad: int
    history: int
    refused: int


def counts(pixels: int, first: int) -> Iterator[Count]:
    """Render the seeds from ``first`` on until there are so many pixels; one count a seed."""
    seed, done = first, 0
    while done < pixels:
        count = _count(seed, pixels - done)
        yield count
        done += count.pixels
        seed += 1


def _count(seed: int, wanted: int) -> Count:
    chosen = combination(seed)
    film = chosen.scene["sensor"]["film"]
    for key in [key for key in film if key.startswith("crop_")]:
        del film[key]
    film |= {"width": SIDE, "height": SIDE}
    scene = mi.load_dict(chosen.scene)
    renderer = mi.load_dict(chosen.parameters | ALL_REUSE)
    frames = min(FRAMES, -(-wanted // SIDE**2))
    bad = history = refused = 0
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "restir_pt: .* cannot be re-projected")
        for t in range(frames):
            bad += not_finite(renderer.render(scene, seed=t, spp=1))
            history += poisoned(renderer)
            refused += renderer.statistics()["not_finite"]
    return Count(seed, frames * SIDE**2, bad, history, refused)
