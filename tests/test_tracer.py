"""The tracer's parts: scattering weights are f/p, and stored vertices are what was hit."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import zoo

from mitsuba_restir.paths.packing import BY_POSITION, fits_compact
from mitsuba_restir.paths.scattering import scatter
from mitsuba_restir.paths.vertex import compact, seen_from, sight, stored
from mitsuba_restir.sampling.streams import PathName

SAMPLES = 24


def camera_hits(scene: mi.Scene, per_pixel: int = SAMPLES):
    """Camera rays (jittered) and what they hit."""
    sensor = scene.sensors()[0]
    width, height = sensor.film().crop_size()
    lane = dr.arange(mi.UInt32, width * height * per_pixel)
    rng = dr.rng(seed=3)
    pixel = lane // per_pixel
    jitter = mi.Point2f(rng.random(mi.Float, dr.width(lane)), rng.random(mi.Float, dr.width(lane)))
    film = (mi.Point2f(pixel % width, pixel // width) + jitter) / mi.Vector2f(width, height)
    ray, _ = sensor.sample_ray(0, 0.5, film, mi.Point2f(0.5))
    return ray, scene.ray_intersect_preliminary(ray)


@pytest.mark.parametrize("kind", ["hit", "record", "compact"])
@pytest.mark.parametrize("name", ["bsdfs", "emitters", "shapes"])
def test_rebuilt_vertices_are_what_was_hit(rgb, name, kind):
    scene = mi.load_dict(zoo.SCENES[name]())
    if kind == "compact" and not fits_compact(scene):
        pytest.skip("some of its shapes need more")
    ray, pi = camera_hits(scene, 4)
    found = pi.compute_surface_interaction(ray)
    if kind == "hit":
        again, pi_again = seen_from(compact(pi, found.p, False), ray.o, ray.wavelengths)
        rebuilt = pi_again.compute_surface_interaction(again)
    else:
        vertex = stored(pi, found.p, kind == "compact")
        rebuilt = sight(vertex, lambda _: ray.o, ray.wavelengths, pi.is_valid()).si
        turned = dr.norm(rebuilt.to_world(rebuilt.wi) - found.to_world(found.wi))
        assert float(dr.max(dr.select(pi.is_valid(), turned, 0))[0]) < 1e-3
    valid = np.array(found.is_valid())
    np.testing.assert_array_equal(np.array(rebuilt.is_valid()), valid)
    assert dr.all((rebuilt.shape == found.shape) | ~found.is_valid())
    assert dr.all((rebuilt.bsdf() == found.bsdf()) | ~found.is_valid())
    for value, original, tolerance in [
        (rebuilt.p, found.p, 2e-5),
        (rebuilt.n, found.n, 1e-3),
        (rebuilt.sh_frame.n, found.sh_frame.n, 1e-3),
        (rebuilt.uv, found.uv, 1e-3),
        (rebuilt.t, found.t, 1e-4),
    ]:
        a, b = (np.atleast_2d(np.array(v))[:, valid] for v in (value, original))
        difference = np.abs(a - b).max(0)
        # The seam of a sphere's texture coordinates is where 0 meets 1.
        assert np.mean(difference > tolerance) < 2e-4


def test_scattering_weight_is_f_over_p(rgb):
    """For every BSDF a non-delta direction has the weight eval/pdf, and the mean is unchanged."""
    scene = mi.load_dict(zoo.bsdf_zoo())
    ray, pi = camera_hits(scene, 64)
    si = pi.compute_surface_interaction(ray)
    bsdf = si.bsdf()
    lane = dr.arange(mi.UInt32, dr.width(ray))
    stream = PathName(lane, mi.UInt32(1), mi.UInt32(0)).stream()
    bounce = scatter(si, bsdf, stream, 1, si.is_valid())

    value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, si.to_local(bounce.wo))
    smooth = np.array(si.is_valid() & ~bounce.delta & (bounce.pdf > 0) & (pdf > 0))
    weight, ratio = np.array(bounce.weight).T[smooth], np.array(value / pdf).T[smooth]
    assert smooth.sum() > 0.5 * dr.width(ray)
    # The direction goes to world space and back, so sharp lobes differ in the last digits.
    close = np.abs(weight - ratio) <= 0.02 * np.abs(ratio) + 1e-4
    assert np.mean(~close.all(1)) < 1e-3
    assert np.all(np.isfinite(np.array(bounce.weight)))
    assert np.all(np.array(bounce.weight) >= 0)

    rng = dr.rng(seed=5)
    count = dr.width(ray)
    u = [rng.random(mi.Float, count) for _ in range(3)]
    _, reference = bsdf.sample(mi.BSDFContext(), si, u[0], mi.Point2f(u[1], u[2]))
    ours, theirs = (np.array(w).T.mean(1) for w in (bounce.weight, reference))
    shape = np.array(dr.reinterpret_array(mi.UInt32, si.shape))
    checked = 0
    for index in np.unique(shape[shape > 0]):
        here = shape == index
        a, b = ours[here], theirs[here]
        error = np.sqrt(a.var() / a.size + b.var() / b.size) + 1e-6
        assert abs(a.mean() - b.mean()) < 5 * error, index
        checked += 1
    assert checked >= len(zoo.bsdfs())


def test_points_of_meshes_are_kept_to_the_last_bit(rgb):
    """Where it is follows from its coordinates, from wherever it is looked at."""
    scene = mi.load_dict(zoo.SCENES["bsdfs"]())
    assert fits_compact(scene)
    ray, pi = camera_hits(scene, 4)
    found = pi.compute_surface_interaction(ray)
    vertex = stored(pi, found.p, True)
    on_mesh = np.array(vertex.on_mesh)
    assert on_mesh.any()
    seen = sight(vertex, lambda p: p + mi.Vector3f(3, -2, 1), ray.wavelengths, pi.is_valid())
    np.testing.assert_array_equal(np.array(seen.p)[:, on_mesh], np.array(found.p)[:, on_mesh])
    np.testing.assert_array_equal(np.array(seen.si.n)[:, on_mesh], np.array(found.n)[:, on_mesh])


@pytest.mark.parametrize("name", BY_POSITION)
def test_some_shapes_need_no_coordinates(rgb, name):
    """Their interactions follow from the position alone."""
    scene = mi.load_dict({"type": "scene", "shape": {"type": name.lower()}})
    ray = mi.Ray3f(mi.Point3f([0.3, -0.2], [3, 3], [0.1, 0.4]), mi.Vector3f(0, -1, 0))
    pi = scene.ray_intersect_preliminary(ray)
    assert dr.all(pi.is_valid())
    without = mi.PreliminaryIntersection3f(pi)
    without.prim_uv = mi.Point2f(0.123, 0.456)
    a, b = (found.compute_surface_interaction(ray) for found in (pi, without))
    for x, y in ((a.p, b.p), (a.n, b.n), (a.uv, b.uv), (a.dp_du, b.dp_du), (a.wi, b.wi)):
        np.testing.assert_array_equal(np.array(x), np.array(y))


@pytest.mark.parametrize(
    ("shape", "fits"),
    [("rectangle", True), ("sphere", True), ("cylinder", True), ("disk", False), ("cube", True)],
)
def test_which_scenes_are_compact(rgb, shape, fits):
    assert fits_compact(mi.load_dict({"type": "scene", "shape": {"type": shape}})) == fits
