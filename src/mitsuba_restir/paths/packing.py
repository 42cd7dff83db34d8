"""How paths and primary hits are stored: the words of their records, and what they stand for.

Pure functions, in pairs. What a record holds lies between kernels and is read at random places of
the image, so that bytes cost time; kernels unpack what they read.
"""

from __future__ import annotations

from typing import Any

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

MOST_INSTANCES, MOST_PRIMITIVES = (1 << INSTANCE_BITS) - 1, 1 << PRIMITIVE_BITS
"""Largest number of an instance that can be stored, and most primitives of its shape group."""

LOWEST_EXPONENT = 7
"""Exponent of the least radiance, as single precision stores it: less is rounded to 0 or to it."""

ON_MESH = 1 << 31
"""Bit of a compact surface: it is a mesh, so that coordinates say where a point of it is."""

SMALL_BITS = 20
"""Bits of the primitive of a compact surface; its shape's number has the 11 others."""


BY_POSITION = ("Sphere", "Cylinder")
"""Classes of shapes whose interactions follow from a position alone."""


def fits_compact(scene: mi.Scene) -> bool:
    """Whether a surface of the scene fits into one word, and where a point of it is into three.

    That is so where there are no instances, shapes have small numbers and at most 2^20 primitives,
    and all of them are meshes or need no coordinates beside a position.
    """
    shapes = scene.shapes()
    if not all(map(_needs_one_place, shapes)):
        return False
    if any(shape.primitive_count() > 1 << SMALL_BITS for shape in shapes):
        return False
    return not shapes or int(dr.max(number_of(mi.ShapePtr(shapes)))[0]) < 1 << (31 - SMALL_BITS)


def _needs_one_place(shape: mi.Shape) -> bool:
    by_coordinates = shape.is_mesh() and not shape.is_ellipsoids()
    return by_coordinates or shape.class_name() in BY_POSITION


def pack_compact(pi: mi.PreliminaryIntersection3f) -> mi.UInt32:
    """The primitive that an intersection is on, in one word; 0 where it is on none."""
    shape = number_of(pi.shape)
    return dr.select(shape != 0, (shape << SMALL_BITS) | pi.prim_index, 0)


def unpack_compact(surface: mi.UInt32) -> tuple[mi.ShapePtr, mi.UInt32]:
    """Shape and index of the primitive, whether it is said to be a mesh or not."""
    number = (surface & ~mi.UInt32(ON_MESH)) >> SMALL_BITS
    return shape_of(number), surface & ((1 << SMALL_BITS) - 1)


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


NORMAL_BITS, FOOTPRINT_BITS = 9, 14
"""Of a primary hit's word: of each of the normal's two numbers, and of the footprint (exponent and
6 bits). Both only decide what may be shared, alike for all who ask."""


def pack_facing(normal: mi.Normal3f, footprint: mi.Float) -> mi.UInt32:
    """The shading normal and the pixel's footprint (not negative) at a primary hit, in one word."""
    half = (1 << (NORMAL_BITS - 1)) - 1
    x, y = (mi.UInt32(mi.Int32(dr.round(c * half)) + half) for c in pack_direction(normal))
    dropped = 31 - FOOTPRINT_BITS
    bits = dr.reinterpret_array(mi.UInt32, mi.Float(footprint)) + (1 << (dropped - 1))
    kept = (bits >> dropped) & ((1 << FOOTPRINT_BITS) - 1)
    return kept | (x << FOOTPRINT_BITS) | (y << (FOOTPRINT_BITS + NORMAL_BITS))


def unpack_normal(facing: mi.UInt32) -> mi.Normal3f:
    """The shading normal, to half a degree."""
    half, mask = (1 << (NORMAL_BITS - 1)) - 1, (1 << NORMAL_BITS) - 1
    x = mi.Int32((facing >> FOOTPRINT_BITS) & mask) - half
    y = mi.Int32((facing >> (FOOTPRINT_BITS + NORMAL_BITS)) & mask) - half
    return mi.Normal3f(unpack_direction(mi.Point2f(mi.Float(x), mi.Float(y)) / half))


def unpack_footprint(facing: mi.UInt32) -> mi.Float:
    """The footprint, to 0.8 %."""
    bits = (facing & ((1 << FOOTPRINT_BITS) - 1)) << (31 - FOOTPRINT_BITS)
    return dr.reinterpret_array(mi.Float, bits)


def pack_direction(direction: mi.Vector3f) -> mi.Point2f:
    """A unit vector as a point of the square from -1 to 1, folded out of an octahedron.

    As exact as single precision (Cigolle et al. 2014).
    """
    x, y, z = direction
    # A record that needs no direction has zeros.
    scale = 1 / dr.maximum(dr.abs(x) + dr.abs(y) + dr.abs(z), dr.smallest(mi.Float))
    point = mi.Point2f(x, y) * scale
    folded = 1 - dr.abs(mi.Point2f(point.y, point.x))
    return dr.select(z < 0, dr.mulsign(folded, point), point)


def unpack_direction(point: mi.Point2f) -> mi.Vector3f:
    """The unit vector of a point of the square."""
    z = 1 - dr.abs(point.x) - dr.abs(point.y)
    folded = dr.maximum(-z, 0)
    flat = point - dr.mulsign(mi.Point2f(folded), point)
    return dr.normalize(mi.Vector3f(flat.x, flat.y, z))


def pack_radiance(radiance: mi.Spectrum, random: tuple[mi.UInt32, mi.UInt32]) -> Any:
    """Radiance in RGB as three integers of 8 bits with a common exponent, in one word.

    Each is rounded up or down at random, so that its expectation is what it was, to 2^-21 of the
    largest. What is computed from radiance has to be computed from what is left of it. Other
    variants keep theirs.

    Parameters
    ----------
    random : (UInt32, UInt32)
        Words of a stream that nothing else reads.
    """
    if not mi.is_rgb:
        return mi.Spectrum(radiance)
    largest = dr.reinterpret_array(mi.UInt32, dr.max(dr.abs(radiance)))
    exponent = dr.clip(largest >> 23, LOWEST_EXPONENT, 254)
    # By 2^(6 - exponent), so that the largest is below 128, and then below 127.
    scale = dr.reinterpret_array(mi.Float, (260 - exponent) << 23) * (127 / 128)
    a, b = random
    numbers = (a >> 11, b >> 11, ((a & 0x7FF) << 10) | (b & 0x3FF))
    word = exponent << 24
    for i, (value, number) in enumerate(zip(radiance, numbers, strict=True)):
        rounded = dr.floor(value * scale + mi.Float(number) * 2.0**-21)
        word |= (mi.UInt32(mi.Int32(rounded)) & 0xFF) << (8 * i)
    return word


def unpack_radiance(packed: Any) -> mi.Spectrum:
    """The radiance that is left."""
    if not mi.is_rgb:
        return mi.Spectrum(packed)
    unit = dr.reinterpret_array(mi.Float, ((packed >> 24) - 6) << 23) * (128 / 127)
    signed = (mi.Int32(packed << (24 - 8 * i)) >> 24 for i in range(3))
    return mi.Color3f(*(mi.Float(number) * unit for number in signed))


def keep_radiance(
    radiance: mi.Spectrum, random: tuple[mi.UInt32, mi.UInt32]
) -> tuple[Any, mi.Spectrum]:
    """Pack radiance; also returned is what is left of it, relative to what it was."""
    packed = pack_radiance(radiance, random)
    share = unpack_radiance(packed) / radiance
    return packed, dr.select(dr.isfinite(share), share, 1)


def no_radiance() -> Any:
    """No radiance, packed."""
    return mi.UInt32(LOWEST_EXPONENT << 24) if mi.is_rgb else dr.zeros(mi.Spectrum)


def number_of(shape: mi.ShapePtr) -> mi.UInt32:
    """Number of a shape in this process; 0 where there is none."""
    return dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))


def shape_of(number: mi.UInt32) -> mi.ShapePtr:
    """The shape of a number."""
    return dr.reinterpret_array(mi.ShapePtr, number)
