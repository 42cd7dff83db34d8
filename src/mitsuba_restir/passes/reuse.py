"""What temporal and spatial reuse share: edits of records and the G-buffer similarity tests."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr

from ..paths.primary_hit import PrimaryHit
from ..paths.record import PathRecord
from ..paths.vertex import exists
from ..resampling.reservoir import Reservoir

NORMAL_COSINE = 0.5
"""Smallest cosine between the shading normals of two pixels that share paths."""

DEPTH_RATIO = 0.1
"""Largest distance of one hit from the other's tangent plane, relative to its camera distance."""


def with_confidence(reservoir: Reservoir, confidence: Any) -> Reservoir:
    """The reservoir with another confidence."""
    return replace(reservoir, confidence=confidence)


def with_factor(path: PathRecord, factor: Any) -> PathRecord:
    """The path as seen from the pixel it was shifted to: the same record, its own p G p."""
    return replace(path, jacobian=factor)


def similar(hit: PrimaryHit, other: PrimaryHit) -> Any:
    """Whether two primary hits may share paths, by normal and depth alone.

    Depth is compared across the tangent plane, so that a surface seen at a grazing angle is similar
    to itself.
    """
    span = other.vertex.p - hit.vertex.p
    depth = dr.norm(hit.vertex.p - hit.origin)
    return (
        exists(hit.vertex)
        & exists(other.vertex)
        & (dr.dot(hit.normal, other.normal) >= NORMAL_COSINE)
        & (dr.abs(dr.dot(hit.normal, span)) <= DEPTH_RATIO * depth)
    )
