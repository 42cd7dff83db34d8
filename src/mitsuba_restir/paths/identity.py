"""Which path a record holds, as a number: equal paths have equal numbers, mutated ones others."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .record import PathRecord

BITS = 24
"""Bits of an identity: as many as a single-precision float holds exactly. Two different paths share
one with a probability of 2^-24."""


def identity(path: PathRecord) -> mi.UInt32:
    """Hash of what names a path, whatever pixel has it (``UInt32`` below 2^24).

    These are its stream (pixel, sample, seed), its shape (kind, technique, k, d), and what a
    mutation moves: the reconnection vertex, the direction to the environment, or the numbers that
    sampled the light. Factors that depend on the pixel do not count.
    """
    moved = [dr.reinterpret_array(mi.UInt32, x) for x in (*path.vertex.place, *path.leaving)]
    name = path.name.short()
    a, b = mi.UInt32(name.pixel), mi.UInt32(name.sample)
    for word in (path.info, *moved):
        a, b = mi.sample_tea_32(a ^ word, b)
    return a >> (32 - BITS)
