"""The strategies by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr

from ..sampling.pairing import pairing_tile
from .exchange import Strategy
from .paired import paired
from .ranked import adjacent, ranked, scattered
from .scored import disk, scored

STRATEGIES = {
    "random": Strategy(pairing_tile, paired),
    "blue_noise": Strategy(scattered("void_and_cluster"), ranked),
    "white_noise": Strategy(scattered("white"), ranked),
    "blocks": Strategy(adjacent, ranked),
    "geometry": Strategy(disk, scored),
}
"""The values of ``neighbor_sampling``."""


def layouts(name: str, radii: Sequence[float]) -> list[Any]:
    """What a strategy finds neighbours with in each round, by their radii [pixels]."""
    made = {radius: STRATEGIES[name].layout(radius) for radius in set(radii)}
    dr.make_opaque(made)
    return [made[radius] for radius in radii]
