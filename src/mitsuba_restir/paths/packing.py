"""How paths and primary hits are stored: the words of their records, and what they stand for.

Pure functions, in pairs. What a record holds lies between kernels and is read at random places of
the image, so that bytes cost time; kernels unpack what they read.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

INSTANCED = 1 << 31
"""Bit of a surface's first word: it is seen through an instance."""

BY_SHAPE = 1 << 30
"""Bit of an instanced surface's first word: its part of the group is a shape's number, not its
index in the group (which of the two Mitsuba needs depends on the backend)."""

INSTANCE_BITS, LOW_BITS, PRIMITIVE_BITS = 20, 10, 23
"""Of an instanced surface: its instance's number and the lower bits of its part fill up the first
word, its primitive and the upper bits of its part the second one."""

MOST_INSTANCES = (1 << INSTANCE_BITS) - 1
"""Largest number of an instance that can be stored."""


def pack_surface(pi: mi.PreliminaryIntersection3f) -> tuple[mi.UInt32, mi.UInt32]:
    """The primitive that an intersection is on, in two words; the first is 0 where it is on none.

    They are the number of its shape and the primitive's, or what :data:`INSTANCE_BITS` says.
    """
    shape, instance = number_of(pi.shape), number_of(pi.instance)
    named = shape != 0
    part = dr.select(named, shape, pi.shape_index)
    low = part & ((1 << LOW_BITS) - 1)
    first = INSTANCED | instance | (low << INSTANCE_BITS) | dr.select(named, mi.UInt32(BY_SHAPE), 0)
    second = pi.prim_index | ((part >> LOW_BITS) << PRIMITIVE_BITS)
    through = instance != 0
    return dr.select(through, first, shape), dr.select(through, second, mi.UInt32(pi.prim_index))


def unpack_surface(
    first: mi.UInt32, second: mi.UInt32
) -> tuple[mi.ShapePtr, mi.ShapePtr, mi.UInt32, mi.UInt32]:
    """Shape, instance, index of the shape in its group, and index of the primitive."""
    through, named = (first & INSTANCED) != 0, (first & BY_SHAPE) != 0
    low = (first >> INSTANCE_BITS) & ((1 << LOW_BITS) - 1)
    part = low | ((second >> PRIMITIVE_BITS) << LOW_BITS)
    shape = dr.select(through, dr.select(named, part, 0), first)
    instance = dr.select(through, first & MOST_INSTANCES, 0)
    primitive = dr.select(through, second & ((1 << PRIMITIVE_BITS) - 1), second)
    index = dr.select(through & ~named, part, 0)
    return shape_of(shape), shape_of(instance), index, primitive


def number_of(shape: mi.ShapePtr) -> mi.UInt32:
    """Number of a shape in this process; 0 where there is none."""
    return dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))


def shape_of(number: mi.UInt32) -> mi.ShapePtr:
    """The shape of a number."""
    return dr.reinterpret_array(mi.ShapePtr, number)
