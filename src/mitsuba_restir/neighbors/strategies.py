"""The strategies by name."""

from __future__ import annotations

from ..sampling.pairing import pairing_tile
from .exchange import Strategy
from .paired import paired
from .ranked import adjacent, ranked, scattered
from .scored import Disk, scored

STRATEGIES = {
    "random": Strategy(pairing_tile, paired),
    "blue_noise": Strategy(scattered("void_and_cluster"), ranked),
    "white_noise": Strategy(scattered("white"), ranked),
    "blocks": Strategy(adjacent, ranked),
    "geometry": Strategy(Disk, scored),
}
"""The values of ``neighbor_sampling``."""
