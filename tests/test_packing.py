"""What records hold comes out of them as it was put in."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir.integrators import border
from mitsuba_restir.passes.primary import camera_rays, primary
from mitsuba_restir.paths.grid import grid_of
from mitsuba_restir.paths.packing import (
    MOST_INSTANCES,
    ON_MESH,
    keep_radiance,
    number_of,
    pack_compact,
    pack_direction,
    pack_facing,
    pack_radiance,
    pack_surface,
    shape_of,
    unpack_compact,
    unpack_direction,
    unpack_footprint,
    unpack_normal,
    unpack_radiance,
    unpack_surface,
)
from mitsuba_restir.sampling.streams import FrameKey
from mitsuba_restir.shifts.connectability import pixel_footprint


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


@pytest.mark.parametrize(("shape", "primitive"), [(1, 0), (2047, 2**20 - 1), (0, 99)])
def test_compact_surfaces_are_kept(rgb, shape, primitive):
    """Without a shape nothing is kept; with the bit of a mesh, the same."""
    word = pack_compact(intersection(shape, 0, 0, primitive))
    for surface in (word, word | ON_MESH):
        found, index = unpack_compact(surface)
        kept = [int(number_of(found)[0]), int(index[0])]
        assert kept == ([shape, primitive] if shape else [0, 0])


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


def directions(count: int) -> mi.Vector3f:
    """Random unit vectors, and those along axes and diagonals."""
    rng = np.random.default_rng(1)
    found = rng.normal(size=(count, 3))
    special = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    found = np.concatenate([found, special[np.abs(special).sum(1) > 0]])
    return mi.Vector3f(*(found / np.linalg.norm(found, axis=1, keepdims=True)).T.astype(np.float32))


def test_directions_are_kept_in_single_precision(rgb):
    wo = directions(100_000)
    found = unpack_direction(pack_direction(wo))
    assert float(dr.max(dr.norm(found - wo))[0]) < 4e-7
    assert float(dr.max(dr.abs(dr.norm(found) - 1))[0]) < 2e-7
    axes = mi.Vector3f([0, 0, 1, -1, 0, 0], [0, 0, 0, 0, 1, -1], [1, -1, 0, 0, 0, 0])
    np.testing.assert_array_equal(np.array(unpack_direction(pack_direction(axes))), np.array(axes))


def test_facing_is_kept_as_exactly_as_said(rgb):
    normal = directions(100_000)
    lanes = dr.width(normal)
    footprint = mi.Float(np.geomspace(1e-30, 1e30, lanes).astype(np.float32))
    facing = pack_facing(mi.Normal3f(normal), footprint)
    angle = dr.norm(mi.Vector3f(unpack_normal(facing)) - normal)
    assert float(dr.max(angle)[0]) < np.radians(0.5)
    assert float(dr.mean(angle)[0]) < np.radians(0.2)
    ratio = unpack_footprint(facing) / footprint
    assert float(dr.max(dr.abs(ratio - 1))[0]) < 0.008
    edge = unpack_footprint(pack_facing(mi.Normal3f(0, 0, 1), mi.Float([0, np.inf])))
    np.testing.assert_array_equal(np.array(edge), [0, np.inf])


@pytest.mark.parametrize("sensor", ["perspective", "thinlens"])
def test_rays_start_where_the_camera_starts_them(rgb, sensor):
    """From one eye or each its own, and their footprints are those of the sensor's own rays."""
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "restir_pt", "temporal": False, "spatial": False},
            "ball": {"type": "sphere"},
            "sensor": {
                "type": sensor,
                "near_clip": 0.5,
                "to_world": mi.ScalarTransform4f().look_at([3, 1, 2], [0, 0.1, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 16, "height": 9, "rfilter": {"type": "box"}},
                **({"aperture_radius": 0.1, "focus_distance": 3.0} if sensor == "thinlens" else {}),
            },
        }
    )
    camera, key = scene.sensors()[0], FrameKey(mi.UInt32(0), mi.UInt32(3))
    now = primary(scene, camera_rays(camera, grid_of(16, 9), key), None, False, True)
    ray, _ = camera.sample_ray(0, 0, now.film, now.lens)
    there = now.hit.vertex.surface != 0
    assert dr.any(there)
    away = dr.select(there, dr.norm(now.hit.origin - ray.o), 0)
    assert float(dr.max(away)[0]) < 1e-5
    si = scene.ray_intersect(ray)
    ratio = now.hit.footprint / pixel_footprint(ray.o, si)
    assert float(dr.max(dr.select(there, dr.abs(ratio - 1), 0))[0]) < 0.01


def test_no_direction_is_kept_as_such(rgb):
    """Zeros stand for it, and are no NaN."""
    np.testing.assert_array_equal(np.array(pack_direction(mi.Vector3f(0))), 0)


def words(count: int) -> tuple[mi.UInt32, mi.UInt32]:
    """Random words."""
    rng = np.random.default_rng(2)
    a, b = (mi.UInt32(rng.integers(2**32, size=count, dtype=np.uint32)) for _ in range(2))
    return a, b


@pytest.mark.parametrize("scale", [1e-36, 1e-3, 1.0, 3e7, 1.5e38])
@pytest.mark.parametrize(
    "color", [(1, 1, 1), (0.7, 0.2, 0.0), (1.0, 1e-3, 1e-5), (-0.3, 1.3, 0.4), (1.999, 0.5, 0.01)]
)
def test_radiance_is_kept_on_the_average(rgb, color, scale):
    """Channel by channel, within 5 standard deviations and the 2^-21 that are promised."""
    count = 1 << 20
    value = np.array(color, dtype=np.float32) * np.float32(scale)
    packed = pack_radiance(mi.Color3f(*value.tolist()), words(count))
    found = np.array(unpack_radiance(packed), dtype=np.float64)
    most = np.abs(value).max()
    assert np.abs(found - value[:, None]).max() < most / 63
    error = np.abs(found.mean(axis=1) - value) - found.std(axis=1) * 5 / count**0.5
    assert error.max() < most * 2**-21
    # Nothing makes light of no light.
    np.testing.assert_array_equal(found[value == 0], 0)


def test_no_light_and_infinite_light(rgb):
    """Neither makes a number that is not finite where there was one."""
    value = mi.Color3f([0, 1e-44, np.inf, np.nan], [0, 0, 1, 1], [0, 0, 0, 1])
    packed, share = keep_radiance(value, words(4))
    left = np.array(unpack_radiance(packed))
    np.testing.assert_array_equal(left[:, 0], 0)
    assert np.abs(left[:, 1]).max() < 1e-36
    assert np.isfinite(np.array(share)).all()


@pytest.mark.parametrize("variant", ["spectral", "mono"])
def test_other_radiance_is_kept_as_it_is(variant, request):
    request.getfixturevalue(variant)
    value = mi.Spectrum(0.1)
    packed, share = keep_radiance(value, words(1))
    np.testing.assert_array_equal(np.array(unpack_radiance(packed)), np.array(value))
    np.testing.assert_array_equal(np.array(share), 1)


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        ("MOST_PRIMITIVES", "instance 'copy' shows 12 primitives, of 1 at most"),
        ("MOST_INSTANCES", "of this process, which may be 1 at most"),
    ],
)
def test_more_instances_than_can_be_told_apart_are_refused(rgb, monkeypatch, limit, words):
    monkeypatch.setattr(border, limit, 1)
    scene = mi.load_dict(
        {
            "type": "scene",
            "floor": {"type": "rectangle"},
            "group": {"type": "shapegroup", "box": {"type": "cube"}},
            "copy": {"type": "instance", "group": {"type": "ref", "id": "group"}},
        },
        parallel=False,
    )
    with pytest.raises(ValueError, match=words):
        border.check_scene(scene)
