"""Shifts are invertible maps: identity, round trip, Jacobian, and rate of success."""

from __future__ import annotations

import itertools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from support import references, rooms
from support.mutants import Mutation, apply
from support.transport import candidates, neighbour, recorded_shift

from mitsuba_restir.paths.primary_hit import PrimaryHit, camera_ray
from mitsuba_restir.paths.record import (
    Kind,
    PathRecord,
    kind_of,
    reconnection_index,
    with_factor,
)
from mitsuba_restir.paths.vertex import exists, sight
from mitsuba_restir.resampling.reservoir import Reservoir
from mitsuba_restir.shifts.hybrid import Shifted
from mitsuba_restir.shifts.mapping import Outcome

pytestmark = pytest.mark.usefixtures("one_thread")

SHIFTS = {
    "hybrid": {},
    "distance": {"connectability": "distance_roughness"},
    "reconnection": {"shift": "reconnection"},
    "replay": {"shift": "random_replay"},
}
SCENES = ["room", "grooves", "far_room", "bsdfs", "emitters", "envmap", "shapes", "glossy_shapes"]

FRAMES = 48

CLOSE = 1e-4
"""Relative difference up to which two colours or Jacobians count as equal."""


def frames(name: str, count: int, **parameters):
    """Scene, recorded shift, its mapping, reservoirs and primary hits of some frames."""
    case = references.CASES[name]
    scene = case.load()
    recorded = None
    for renderer, reservoirs, hits in itertools.islice(
        candidates(case.max_depth, scene, **parameters), count
    ):
        recorded = recorded or recorded_shift(renderer)
        yield scene, recorded, renderer._plan.mapping, reservoirs, hits


def relative(a, b) -> np.ndarray:
    """Largest difference of two colours, relative to the brighter one."""
    a, b = np.array(a, dtype=np.float64), np.array(b, dtype=np.float64)
    scale = np.maximum(np.abs(a).max(0), np.abs(b).max(0))
    return np.abs(a - b).max(0) / np.maximum(scale, 1e-30)


CASES = [(name, "hybrid") for name in SCENES]
CASES += [("corner_small", "hybrid")]
CASES += [(name, shift) for name in ("room", "far_room") for shift in SHIFTS if shift != "hybrid"]


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_identity_and_round_trip(rgb, name, kind):
    """Shifted to its own pixel, a path keeps F, with Jacobian one; shifted away, it comes back.

    Kernels may round differently, so a path can find another triangle, a grazing shadow ray another
    end, and a limit be met to the last bit: this must stay below one in 10^5 replays.

    A reconnection aims at a stored point, which a traced ray meets up to its rounding, so the first
    reconnection of a path changes F and J in the last digits, and may move it across a limit of the
    connectability test (``boundary``); from then on nothing changes.
    """
    tried = changed = boundary = shifted = lost = wrong = 0
    rounding = []
    for scene, shift, mapping, r, hits in frames(name, FRAMES, **SHIFTS[kind]):
        there = r.weight > 0
        own = shift(scene, r.path, hits, there)
        if not mapping.replays:  # pure reconnection knows only paths that need no replay
            there &= own.outcome != Outcome.UNCONNECTABLE
        replayed = np.array(kind_of(r.path) < Kind.FAR)
        kept = np.array(own.outcome) == Outcome.OK
        error = np.maximum(relative(own.color, r.color), np.abs(np.array(own.jacobian) - 1))
        there = np.array(there)
        rounding.append(error[there & kept & ~replayed])
        tried += there.sum()
        changed += (there & replayed & ~(kept & (error < CLOSE))).sum()
        boundary += (there & ~replayed & ~kept).sum()

        other, inside = neighbour(scene, (3, 2))
        near = hits.at(other, inside)
        path = dr.gather(PathRecord, r.path, other, inside)
        start = dr.gather(Shifted, own, other, inside)
        forth = shift(scene, path, hits, inside & (start.outcome == Outcome.OK))
        arrived = forth.outcome == Outcome.OK
        back = shift(scene, with_factor(path, forth.factor), near, arrived)
        arrived, returned = np.array(arrived), np.array(back.outcome) == Outcome.OK
        # From the path as it is reconnected: J J^-1 = 1 and F as it was.
        ratio = np.array(back.jacobian * forth.factor / start.factor, np.float64)
        same = (relative(back.color, start.color) < CLOSE) & (np.abs(ratio - 1) < CLOSE)
        shifted += arrived.sum()
        lost += (arrived & ~returned).sum()
        wrong += (arrived & returned & ~same).sum()
    rounding = np.concatenate([*rounding, [0.0]])
    median, rare = np.quantile(rounding, [0.5, 0.99])
    print(
        f"{name}-{kind}: of {tried}, {changed} replays and {boundary} reconnections differ in "
        f"their own pixel (rounding of reconnections: median {median:.0e}, 99 % {rare:.0e}); "
        f"of {shifted} round trips, {lost} are lost and {wrong} changed"
    )
    assert tried > 20000
    assert shifted > 10000
    assert changed <= 2 + 1e-5 * tried
    assert boundary <= 2 + 1e-5 * tried
    assert lost + wrong <= 3 + 1e-5 * shifted
    assert median < 2e-6
    assert rare < 1e-4


@pytest.mark.parametrize(
    "late",
    [
        # F of a candidate is computed from radiance as it was before the record was rounded.
        Mutation("dr.select(used, share * left, 1)", "mi.Spectrum(1)"),
        # Where the light goes on from x_{k+1} to x_k, only what is kept at x_k counts.
        Mutation("dr.select(used, share * left, 1)", "dr.select(used, left, 1)"),
    ],
)
def test_radiance_that_is_rounded_too_late_is_seen(rgb, monkeypatch, late):
    """A path then has another F in its own pixel than its candidate had."""
    apply(monkeypatch, (late,))
    errors = []
    for scene, shift, _, r, hits in frames("room", 4, mutations=1, mutation_interval=64):
        own = shift(scene, r.path, hits, r.weight > 0)
        fine = np.array((own.outcome == Outcome.OK) & (kind_of(r.path) == Kind.FAR))
        errors.append(relative(own.color, r.color)[fine])
    assert np.median(np.concatenate(errors)) > 1e-3


@pytest.mark.parametrize(
    ("name", "rate"), [("far_room", 0.9), ("room", 0.8), ("bsdfs", 0.6), ("glossy_shapes", 0.5)]
)
def test_shifts_succeed(rgb, name, rate):
    """A shift that silently failed would be unbiased, and useless."""
    tried = arrived = 0
    for scene, shift, _, r, hits in frames(name, 4):
        other, inside = neighbour(scene, (1, 1))
        theirs = dr.gather(Reservoir, r, other, inside)
        there = inside & (theirs.weight > 0) & exists(hits.vertex)
        moved = shift(scene, theirs.path, hits, there)
        tried += np.array(there).sum()
        arrived += (np.array(moved.outcome) == Outcome.OK).sum()
    print(f"{name}: {arrived / tried:.1%} of {tried} shifts succeed")
    assert arrived > rate * tried


def test_nothing_comes_of_nothing(rgb):
    """Empty paths, missed pixels and idle lanes have colour 0 and say why."""
    for scene, shift, _, r, hits in frames("envmap", 1):
        sky = ~exists(hits.vertex)
        assert dr.any(sky)
        assert not dr.any(sky & (r.weight > 0))
        no_lane = dr.full(mi.Bool, False, dr.width(sky))
        idle = shift(scene, r.path, hits, no_lane)
        assert dr.all(idle.outcome == Outcome.EMPTY)
        assert dr.all(dr.max(idle.color) == 0)
        assert dr.all(idle.jacobian == 1)


def ray_origin(hits: PrimaryHit, point) -> np.ndarray:
    """Where rays from primary hits to given points start: off their surface."""
    ray, pi = camera_ray(hits, [])
    return pi.compute_surface_interaction(ray).spawn_ray_to(point).o


def _disk(origin: np.ndarray, normal: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Where cosine sampling at ``origin`` finds the direction of ``point`` in its unit disk."""
    helper = np.where(np.abs(normal[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    s = np.cross(helper, normal)
    s /= np.linalg.norm(s, axis=1, keepdims=True)
    t = np.cross(normal, s)
    d = point - origin
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    return np.stack([(d * s).sum(1), (d * t).sum(1)], axis=1)


def _determinant(origin, normal, point, tangents, step: float) -> np.ndarray:
    columns = [
        (_disk(origin, normal, point + step * t) - _disk(origin, normal, point - step * t))
        / (2 * step)
        for t in tangents
    ]
    return np.abs(columns[0][:, 0] * columns[1][:, 1] - columns[0][:, 1] * columns[1][:, 0])


def test_jacobian_agrees_with_finite_differences(rgb):
    """Diffuse surfaces: primary samples are the disk of the cosine-weighted directions.

    The reconnection vertex is moved in its plane, and the samples that lead to it from either pixel
    are found by inverting the cosine sampling; the ratio of their areas is the Jacobian.
    """
    white = {"type": "twosided", "nested": {"type": "diffuse", "reflectance": 0.6}}
    description = rooms.open_room()
    description["floor"] = {**description["floor"], "bsdf": white}
    scene = mi.load_dict(description)
    compared = 0
    recorded = None
    for renderer, r, hits in itertools.islice(candidates(5, scene), 8):
        other, inside = neighbour(scene, (6, 5))
        theirs = dr.gather(Reservoir, r, other, inside)
        near = hits.at(other, inside)
        recorded = recorded or recorded_shift(renderer)
        own = recorded(scene, r.path, hits, r.weight > 0)
        start = dr.gather(mi.Float, own.factor, other, inside)
        moved = recorded(scene, theirs.path, hits, inside & (theirs.weight > 0))
        seen = sight(theirs.path.vertex, lambda _, p=near.vertex.p: p, [], True)
        ray, si = seen.ray, seen.si
        use = np.array(
            (moved.outcome == Outcome.OK)
            & (reconnection_index(theirs.path) == 2)
            & (dr.abs(dr.dot(si.n, ray.d)) > 0.05)
        )
        x, nx, y, ny, p, n = (
            np.array(v, dtype=np.float64).T[use]
            for v in (
                ray_origin(near, si.p),
                near.normal,
                ray_origin(hits, si.p),
                hits.normal,
                si.p,
                si.n,
            )
        )
        helper = np.where(np.abs(n[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
        s = np.cross(helper, n)
        tangents = (s, np.cross(n, s))
        expected = _determinant(y, ny, p, tangents, 1e-5) / _determinant(x, nx, p, tangents, 1e-5)
        found = np.array(moved.factor / start)[use]
        np.testing.assert_allclose(found, expected, rtol=1e-3)
        compared += use.sum()
    assert compared > 1000


def test_pairwise_weights_are_a_partition(rgb):
    """At a shifted path y, the neighbour's and the pixel's own pairwise weights sum to one.

    The pixel evaluates its share by shifting y back: the two must see the same densities.
    """
    for scene, shift, _, r, hits in frames("room", 4):
        other, inside = neighbour(scene, (2, 3))
        near = hits.at(other, inside)
        path = dr.gather(PathRecord, r.path, other, inside)
        own = shift(scene, r.path, hits, r.weight > 0)
        start = dr.gather(Shifted, own, other, inside)
        path = with_factor(path, start.factor)
        forth = shift(scene, path, hits, inside & (start.outcome == Outcome.OK))
        path = with_factor(path, forth.factor)
        back = shift(scene, path, near, forth.outcome == Outcome.OK)
        both = np.array((forth.outcome == Outcome.OK) & (back.outcome == Outcome.OK))
        here = np.array(mi.luminance(forth.color), np.float64)[both]
        there = np.array(mi.luminance(start.color) / forth.jacobian, np.float64)[both]
        seen = np.array(mi.luminance(back.color) * back.jacobian, np.float64)[both]
        total = there / (there + here) + here / (here + seen)
        assert both.sum() > 300
        np.testing.assert_allclose(total, 1, atol=1e-5)
