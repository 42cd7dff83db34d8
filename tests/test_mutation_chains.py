"""Long chains of mutations of one path: where they end, against the target function in closed form.

All lanes start from the same path. What follows the moved vertex stays what it is, so the final
vertices are distributed as the path's contribution with everything else fixed: factors f, G and MIS
weights of diffuse surfaces, written down here by hand.

The false-alarm rate of each chi-square test is 1e-4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats
from support.modes import Mode
from support.mutants import Mutation, apply
from support.runs import integrator
from support.scopes import mutate, mutation_plan, point_of, scope_of

from mitsuba_restir.paths.primary_hit import PrimaryHit
from mitsuba_restir.paths.record import (
    Kind,
    edge_count,
    kind_of,
    next_kind_of,
    reconnection_index,
)
from mitsuba_restir.resampling.reservoir import Reservoir

pytestmark = pytest.mark.usefixtures("one_thread")

LANES, STEPS = 1 << 14, 100
CELLS, FINE = 8, 16

CEILING, HALF = 2.0, 1.5  # the square z = 2, |x|, |y| <= 1.5, above the floor z = 0
LIGHT, REACH = 2.0, 0.4  # the square x = 2, |y|, |z - 1| <= 0.4, which shines towards -x
AREA = (2 * REACH) ** 2


def chain_scene(low: float) -> mi.Scene:
    """All pixels see the origin; the half of the ceiling with x > 0 may hang lower."""
    transform = mi.ScalarTransform4f
    up, toward = [1, 0, 0], [0, 1, 0]
    whole = [(0.0, CEILING, HALF)]
    halves = [(-HALF / 2, CEILING, HALF / 2), (HALF / 2, low, HALF / 2)]
    ceilings = {
        f"ceiling_{i}": {
            "type": "rectangle",
            "to_world": transform().translate([x, 0, z]).rotate(up, 180).scale([width, HALF, 1]),
        }
        for i, (x, z, width) in enumerate(whole if low == CEILING else halves)
    }
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": {
                "type": "perspective",
                "fov": 1e-3,
                "to_world": transform().look_at([0, -3, 3], [0, 0, 0], [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": 64, "height": 64, "rfilter": {"type": "box"}},
                "sampler": {"type": "independent"},
            },
            "floor": {"type": "rectangle", "to_world": transform().scale(4)},
            **ceilings,
            "light": {
                "type": "rectangle",
                "to_world": transform().translate([LIGHT, 0, 1]).rotate(toward, -90).scale(REACH),
                "emitter": {"type": "area", "radiance": 1.0},
            },
        }
    )


# ------------------------------ densities by hand -----------------------------------------------

Points = np.ndarray  # (..., 3)


def geometry(a: Points, normal_a: Points, b: Points, normal_b: Points) -> np.ndarray:
    """G(a, b): the cosines at both ends over the squared distance."""
    span = b - a
    squared = (span**2).sum(axis=-1)
    return np.abs((span @ normal_a) * (span @ normal_b)) / squared**2


FLOOR_NORMAL, LIGHT_NORMAL = np.array([0.0, 0, 1]), np.array([-1.0, 0, 0])
ORIGIN = np.zeros(3)


def pdfs_of_light(x: Points, z: Points) -> tuple[np.ndarray, np.ndarray]:
    """Solid-angle densities [1/sr] of z from a diffuse x: of a bounce, of sampling the light."""
    span = z - x
    distance = np.sqrt((span**2).sum(axis=-1))
    bounce = np.abs(span @ FLOOR_NORMAL) / distance / np.pi
    return bounce, distance**3 / (AREA * np.abs(span @ LIGHT_NORMAL))


def to_ceiling(x: Points) -> np.ndarray:
    return geometry(ORIGIN, FLOOR_NORMAL, x, FLOOR_NORMAL)


def before_surface(x: Points, path: dict[str, np.ndarray]) -> np.ndarray:
    return to_ceiling(x) * geometry(x, FLOOR_NORMAL, path["next"], FLOOR_NORMAL)


def before_light_sample(x: Points, path: dict[str, np.ndarray]) -> np.ndarray:
    """The light point is where the stored direction meets the light."""
    z = path["vertex"] + path["wo"] * (LIGHT - path["vertex"][0]) / path["wo"][0]
    bounce, sampled = pdfs_of_light(x, z)
    share = sampled / (bounce + sampled)
    return to_ceiling(x) * geometry(x, FLOOR_NORMAL, z, LIGHT_NORMAL) * share


def before_light(x: Points, path: dict[str, np.ndarray]) -> np.ndarray:
    bounce, sampled = pdfs_of_light(x, path["next"])
    share = bounce / (bounce + sampled)
    return to_ceiling(x) * geometry(x, FLOOR_NORMAL, path["next"], LIGHT_NORMAL) * share


def on_light_vertex(x: Points, path: dict[str, np.ndarray]) -> np.ndarray:
    bounce, sampled = pdfs_of_light(ORIGIN, x)
    return geometry(ORIGIN, FLOOR_NORMAL, x, LIGHT_NORMAL) * bounce / (bounce + sampled)


def light_numbers(x: Points, path: dict[str, np.ndarray]) -> np.ndarray:
    """The numbers are uniform on the light, so a density of its points is one of the numbers."""
    bounce, sampled = pdfs_of_light(ORIGIN, x)
    return geometry(ORIGIN, FLOOR_NORMAL, x, LIGHT_NORMAL) * sampled / (bounce + sampled)


@dataclass(frozen=True)
class Chain:
    """Which path starts the chain, in which square its vertex moves, and with which density."""

    kind: int
    edges: int
    density: Callable[[Points, dict[str, np.ndarray]], np.ndarray]
    on_light: bool = False
    next_kind: int = Kind.EMPTY
    step: float = 0.4
    low: float = CEILING
    surrogates: int = 0


CHAINS = {
    "surface, light sampled from it": Chain(Kind.FAR, 4, before_surface, next_kind=Kind.NEE),
    "surface, light found from it": Chain(Kind.FAR, 4, before_surface, next_kind=Kind.HIT),
    "surface, longer": Chain(Kind.FAR, 5, before_surface, next_kind=Kind.FAR),
    "light sample": Chain(Kind.NEE, 3, before_light_sample),
    "light": Chain(Kind.HIT, 3, before_light),
    "on the light": Chain(Kind.LIGHT, 2, on_light_vertex, on_light=True, step=0.1),
    "light numbers": Chain(Kind.REPLAY_NEE, 2, light_numbers, on_light=True),
}
FOLDED = Chain(Kind.FAR, 4, before_surface, next_kind=Kind.NEE, low=0.6)
CHAINS["surface, two planes"] = FOLDED
CHAINS |= {
    f"{name}, surrogates": replace(chain, surrogates=4) for name, chain in list(CHAINS.items())
}

# ------------------------------ chains ----------------------------------------------------------


@cache
def candidates(low: float) -> tuple[mi.Scene, Any, list[Any]]:
    """The scene, a renderer, and its reservoirs and hits of some frames of candidates alone."""
    scene = chain_scene(low)
    renderer = integrator(6, Mode({"temporal": False, "spatial": False}), mutations=1)
    frames = []
    for seed in range(3, 11):  # whose first paths make chains that get about
        renderer.render(scene, seed=seed, spp=1)
        frames.append((renderer._history.reservoirs, renderer._history.hits))
    return scene, renderer, frames


@pytest.fixture(scope="module", autouse=True)
def forgotten_at_the_end() -> Iterator[None]:
    """A scene that is alive is gone through at every replay, by all later tests of the process."""
    yield
    candidates.cache_clear()


def first_of(chain: Chain) -> tuple[mi.Scene, Any, Reservoir, PrimaryHit]:
    """Copies of the first path that fits."""
    scene, renderer, frames = candidates(chain.low)
    for reservoirs, hits in frames:
        path = reservoirs.path
        fits = (kind_of(path) == chain.kind) & (edge_count(path) == chain.edges)
        if chain.kind >= Kind.FAR:
            fits &= reconnection_index(path) == 2
        if chain.kind == Kind.FAR:
            fits &= next_kind_of(path) == chain.next_kind
            # The next vertex is on the floor, not on the ceiling's other side or edge.
            fits &= dr.abs(point_of(path.next.vertex).z) < 1e-3
        if chain.low < CEILING:
            # Neither half of the ceiling hides the other from there.
            fits &= point_of(path.next.vertex).x < 0
        found = np.flatnonzero(np.array(fits & (reservoirs.weight > 0)))
        if len(found):
            lane = dr.full(mi.UInt32, int(found[0]), LANES)
            return (
                scene,
                renderer,
                dr.gather(Reservoir, reservoirs, lane),
                hits.at(lane),
            )
    raise AssertionError("no path fits")


def p_value(chain: Chain) -> float:
    """Chi-square test of the final vertices."""
    scene, renderer, start, hits = first_of(chain)
    dr.eval(start, hits)
    scope = scope_of(renderer, scene, number=1, seed=2)
    plan = mutation_plan(STEPS, chain.step, surrogates=chain.surrogates)
    after, mutated = mutate(scope, start, hits, plan)
    assert float(dr.mean(mi.Float(mutated.accepted))[0]) > 0.1 * STEPS
    path = {
        "vertex": np.array(point_of(start.path.vertex))[:, 0].astype(float),
        "wo": np.array(start.path.wo)[:, 0].astype(float),
        "next": np.array(point_of(start.path.next.vertex))[:, 0].astype(float),
    }
    ends = np.array(point_of(after.path.vertex)).T
    if chain.kind == Kind.REPLAY_NEE:
        numbers = after.path.leaving
        reference = dr.zeros(mi.Interaction3f)
        reference.p = hits.vertex.p
        ends = np.array(scene.sample_emitter_direction(reference, numbers, False)[0].p).T
    edges = np.linspace(-1, 1, CELLS + 1)
    fine = np.linspace(-1, 1, 2 * CELLS * FINE + 1)[1::2]
    s, t = np.meshgrid(fine, fine, indexing="ij")
    if chain.on_light:
        grid = np.stack([np.full_like(s, LIGHT), REACH * s, 1 + REACH * t], axis=-1)
        ends = np.stack([ends[:, 1], ends[:, 2] - 1], axis=-1) / REACH
    else:
        grid = np.stack([HALF * s, HALF * t, np.where(s > 0, chain.low, CEILING)], axis=-1)
        ends = ends[:, :2] / HALF
    assert np.abs(ends).max() < 1 + 1e-5
    expected = chain.density(grid, path).reshape(CELLS, FINE, CELLS, FINE).sum(axis=(1, 3))
    observed, _, _ = np.histogram2d(*ends.clip(-1, 1).T, bins=(edges, edges))
    expected *= observed.sum() / expected.sum()
    common = expected > 20
    assert common.sum() > CELLS**2 / 2
    observed, expected = (
        np.append(shares[common], shares[~common].sum()) for shares in (observed, expected)
    )
    likely = expected > 0
    return float(stats.chisquare(observed[likely], expected[likely]).pvalue)


@pytest.mark.parametrize("name", CHAINS)
def test_final_states_follow_the_target_function(rgb, name):
    found = p_value(CHAINS[name])
    print(f"{name}: p = {found:.3g}")
    assert found > 1e-4


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("surface, longer", "pdf_k * dr.select(ahead, geometry, 1)", "mi.Float(1)"),
        ("light", "dr.select(ahead, geometry, 1)", "mi.Float(1)"),
        ("surface, longer", "dr.select(by_numbers, 1, pdf)", "mi.Float(1)"),
        ("light sample", "(uniform(random, i, 2) < acceptance(state, proposal))", "mi.Bool(True)"),
        # The way back over the way there: without it, the surrogate's density is left, too.
        ("light, surrogates", "first / density", "mi.Float(1)"),
        ("surface, longer, surrogates", "first / density", "mi.Float(1)"),
        # The surrogate of the other state's plane is another function.
        (
            "surface, two planes, surrogates",
            "dr.select(same_plane(pivot, state, proposed), way_back, 0)",
            "mi.Float(way_back)",
        ),
    ],
)
def test_control(rgb, monkeypatch, name, old, new):
    apply(monkeypatch, (Mutation(old, new),))
    found = p_value(CHAINS[name])
    print(f"{name} without {old}: p = {found:.3g}")
    assert found < 1e-6
