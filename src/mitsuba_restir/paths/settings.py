"""How long paths may be: the part of the integrator's parameters that the tracer reads."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PathLimits:
    """Limits of a path.

    Attributes
    ----------
    max_depth : int
        Largest number of edges (1 is directly visible emission).
    rr_depth : int
        Depth from which candidates are subject to Russian roulette.
    """

    max_depth: int
    rr_depth: int
