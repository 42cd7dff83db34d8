"""What records hold comes out of them as it was put in."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir.paths.packing import (
    MOST_INSTANCES,
    number_of,
    pack_surface,
    shape_of,
    unpack_surface,
)


def intersection(
    shape: int, instance: int, index: int, primitive: int
) -> mi.PreliminaryIntersection3f:
    pi = dr.zeros(mi.PreliminaryIntersection3f)
    pi.shape, pi.instance = shape_of(mi.UInt32(shape)), shape_of(mi.UInt32(instance))
    pi.shape_index, pi.prim_index = mi.UInt32(index), mi.UInt32(primitive)
    return pi


@pytest.mark.parametrize(
    ("shape", "instance", "index", "primitive"),
    [
        (1, 0, 0, 2**32 - 1),
        (2**30, 0, 0, 7),
        (0, 5, 0, 0),
        (0, MOST_INSTANCES, 2**19 - 1, 2**23 - 1),
        (2**19 - 1, 3, 0, 2**23 - 1),
    ],
)
def test_surfaces_are_kept(rgb, shape, instance, index, primitive):
    words = pack_surface(intersection(shape, instance, index, primitive))
    assert words[0][0] != 0
    found = unpack_surface(*words)
    numbers = [int(number_of(pointer)[0]) for pointer in found[:2]]
    assert [*numbers, int(found[2][0]), int(found[3][0])] == [shape, instance, index, primitive]


def test_no_surface_is_none(rgb):
    assert pack_surface(intersection(0, 0, 9, 9))[0][0] == 0


def test_surfaces_of_a_scene_are_kept(rgb):
    """Shapes by themselves and through instances, as rays find them."""
    scene = mi.load_dict(
        {
            "type": "scene",
            "floor": {"type": "rectangle"},
            "group": {
                "type": "shapegroup",
                "box": {"type": "cube"},
                "flat": {
                    "type": "rectangle",
                    "to_world": mi.ScalarTransform4f().translate([3, 0, 0]),
                },
            },
            "copy": {
                "type": "instance",
                "group": {"type": "ref", "id": "group"},
                "to_world": mi.ScalarTransform4f().translate([5, 0, 0]),
            },
        }
    )
    x = mi.Float([0, 5, 8, 20])
    ray = mi.Ray3f(mi.Point3f(x, 0.1, 10), mi.Vector3f(0, 0, -1))
    pi = scene.ray_intersect_preliminary(ray)
    again = mi.PreliminaryIntersection3f(pi)
    again.shape, again.instance, again.shape_index, again.prim_index = unpack_surface(
        *pack_surface(pi)
    )
    hit = pi.is_valid()
    np.testing.assert_array_equal(np.array(hit), [True, True, True, False])
    ours, theirs = (found.compute_surface_interaction(ray) for found in (again, pi))
    for a, b in ((ours.p, theirs.p), (ours.n, theirs.n), (ours.uv, theirs.uv)):
        np.testing.assert_array_equal(np.array(a), np.array(b))
