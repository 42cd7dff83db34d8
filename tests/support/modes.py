"""The modes of ``restir_pt`` that must all converge to the same image."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

_NO_REUSE = {"temporal": False, "spatial": False}
_SPATIAL = {"temporal": False, "spatial_radius": 6.0}
_TEMPORAL = {"spatial": False}
_BOTH = {"spatial_radius": 6.0}


@dataclass(frozen=True)
class Mode:
    """Parameters of the integrator, candidates per pixel, and frames of a run (the last counts)."""

    parameters: dict[str, Any] = field(default_factory=dict)
    spp: int = 1
    frames: int = 1


MODES = {
    "candidates_1": Mode(_NO_REUSE),
    "candidates_4": Mode(_NO_REUSE, spp=4),
    "spatial_1": Mode(_SPATIAL),
    "spatial_3": Mode({**_SPATIAL, "spatial_rounds": 3}),
    "spatial_replay": Mode({**_SPATIAL, "shift": "random_replay"}),
    "spatial_reconnection": Mode({**_SPATIAL, "shift": "reconnection"}),
    "spatial_distance": Mode({**_SPATIAL, "connectability": "distance_roughness"}),
    "temporal": Mode(_TEMPORAL, frames=4),
    "both": Mode(_BOTH, frames=3),
    "both_4": Mode(_BOTH, spp=4, frames=3),
    "both_replay": Mode({**_BOTH, "shift": "random_replay"}, frames=3),
    "both_reconnection": Mode({**_BOTH, "shift": "reconnection"}, frames=3),
    "both_distance": Mode({**_BOTH, "connectability": "distance_roughness"}, frames=3),
}
