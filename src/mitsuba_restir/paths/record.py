"""The path record: what must be stored of a path so that any pixel can evaluate it again.

A path x0 (camera), x1 (primary hit), ..., x_d (light) is described by the stream that generated its
prefix, its reconnection vertex x_k, the direction leaving it, and the light arriving along it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from .vertex import Vertex, no_vertex

# How a path ends relative to its reconnection vertex x_k.
EMPTY = 0  # no path
REPLAY_NEE = 1  # no x_k; the light is sampled from the last replayed vertex
REPLAY_HIT = 2  # no x_k; the last replayed bounce finds the light
FAR = 3  # the light is two or more vertices after x_k
NEE = 4  # the light is sampled from x_k
HIT = 5  # the bounce from x_k finds the light
LIGHT = 6  # x_k is itself on a light, found by a bounce
ENVIRONMENT = 7  # x_k is the environment, found by a bounce

MAX_EDGES = 0x3FFF
"""Longest path that a record can describe (14 bits)."""


@dataclass
class PathRecord:
    """A path that can be replayed or reconnected, one per lane.

    Fields: ``pixel``, ``sample``, ``seed`` (``UInt32``) name the prefix's stream. ``info`` packs
    kind, technique, k and d. ``vertex`` is x_k, ``wo`` (``Vector3f``, world) the direction that
    leaves it (for ``ENVIRONMENT`` the one that leaves x_{k-1}). ``radiance`` (``Spectrum``) is the
    light arriving along ``wo``: the suffix's throughput and MIS weight are part of it for ``FAR``,
    emission alone for ``HIT`` and ``ENVIRONMENT``, emission over the light pdf for ``NEE``; unused
    for ``LIGHT``, whose emission depends on the direction. ``light_pdf`` [1/sr] is the MIS partner
    of ``NEE``, ``HIT`` and ``ENVIRONMENT``; 0 stands for a light that only one technique can find.
    ``jacobian`` is this path's own factor p_{k-1} G p_k of the reconnection Jacobian.
    """

    pixel: Any
    sample: Any
    seed: Any
    info: Any
    vertex: Vertex
    wo: Any
    radiance: Any
    light_pdf: Any
    jacobian: Any


def empty_record() -> PathRecord:
    """The record of no path (kind ``EMPTY``)."""
    return PathRecord(
        mi.UInt32(0),
        mi.UInt32(0),
        mi.UInt32(0),
        mi.UInt32(0),
        no_vertex(),
        dr.zeros(mi.Vector3f),
        dr.zeros(mi.Spectrum),
        mi.Float(0),
        mi.Float(0),
    )


def pack_info(kind: Any, by_nee: Any, k: Any, edges: Any) -> Any:
    """Pack kind (3 bits), "ends by NEE" (1), k (14) and the number of edges d (14) in one word."""
    return mi.UInt32(kind) | dr.select(by_nee, mi.UInt32(8), 0) | (k << 4) | (edges << 18)


def kind_of(record: PathRecord) -> Any:
    """Kind of the path (``UInt32``, one of the module's constants)."""
    return record.info & 7


def ends_by_nee(record: PathRecord) -> Any:
    """Lanes whose light vertex was sampled from the lights rather than found by a bounce."""
    return (record.info & 8) != 0


def reconnection_index(record: PathRecord) -> Any:
    """Index k of the reconnection vertex, 0 where the path has none."""
    return (record.info >> 4) & MAX_EDGES


def edge_count(record: PathRecord) -> Any:
    """Number of edges d, the depth in Mitsuba's sense (1 is directly visible emission)."""
    return record.info >> 18
