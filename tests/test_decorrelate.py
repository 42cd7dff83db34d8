"""Mutations leave every pixel's expectation alone, and each of their factors is needed for that.

A mutation never changes the luminance of its own pixel, whatever is wrong with it, so the tests
look elsewhere: through a neighbour's target function (the transport identity), at the image after
spatial reuse, per colour channel, and at the distribution of the states of the chain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats
from support import references
from support.bias import BiasReport
from support.modes import Mode
from support.mutants import Mutation, apply
from support.runs import assert_unbiased, integrator
from support.scopes import mutate, mutation_plan, scope_of
from support.stationarity import FRESH, stationarity_report
from test_unbiased import ROOM, check, edited, moving_camera

from mitsuba_restir.mutations import proposals
from mitsuba_restir.mutations.chain import metropolis_hastings
from mitsuba_restir.mutations.pivot import MutationClass, movable
from mitsuba_restir.paths.spectrum import target
from mitsuba_restir.shifts.hybrid import shift
from mitsuba_restir.shifts.mapping import Outcome

pytestmark = pytest.mark.usefixtures("one_thread")

STEP = 0.2

# ------------------------------ invariance of the own luminance ---------------------------------

RULES = {
    "metropolis": metropolis_hastings,
    "always": lambda current, proposal: mi.Float(1),
    "rarely": lambda current, proposal: mi.Float(0.05),
    "brighter only": lambda current, proposal: dr.select(
        target(proposal.state.color) > target(current.color), mi.Float(1), 0
    ),
}


@pytest.mark.parametrize("name", ["room", "bsdfs", "envmap"])
@pytest.mark.parametrize("rule", RULES)
def test_own_luminance_is_invariant(rgb, name, rule):
    case = references.CASES[name]
    scene = case.load()
    renderer = integrator(case.max_depth, Mode({"temporal": False, "spatial": False}), mutations=1)
    renderer.render(scene, seed=3, spp=1)
    before, hits = renderer._history.reservoirs, renderer._history.hits
    scope = scope_of(renderer, scene, number=1, seed=2)
    after, mutated = mutate(scope, before, hits, mutation_plan(5, STEP), RULES[rule])
    old = np.array(target(before.color) * before.weight)
    new = np.array(target(after.color) * after.weight)
    assert int(dr.sum(mutated.accepted)[0]) > 20
    np.testing.assert_allclose(new, old, rtol=3e-5, atol=1e-12)


def unlike_themselves(name: str, frames: int) -> tuple[int, int]:
    """Accepted mutations whose path cannot be shifted to its own pixel, and all accepted ones."""
    case = references.CASES[name]
    scene = case.load()
    renderer = integrator(
        case.max_depth,
        Mode({"temporal": False, "spatial": False}),
        mutations=20,
        mutation_step=0.5,
    )
    lost = total = 0
    for seed in range(frames):
        renderer.render(scene, seed=seed, spp=1)
        paths = renderer._history.reservoirs.path
        hits = renderer._history.hits
        moved = renderer.frame.mutated.accepted > 0
        shifted = shift(scope_of(renderer, scene), paths, hits, moved)
        lost += int(dr.count(moved & (shifted.outcome != Outcome.OK))[0])
        total += int(dr.count(moved)[0])
    return lost, total


@pytest.mark.parametrize("name", ["far_room", "grooves", "bsdfs"])
def test_mutated_paths_shift_to_their_own_pixel(rgb, name):
    lost, total = unlike_themselves(name, 100)
    print(f"{name}: {lost} of {total}")
    assert total > 20000
    assert lost < 1e-4 * total


def test_control_of_connectability_before_the_pivot(rgb, monkeypatch):
    """Without the second test of that pair, a path gets another reconnection vertex."""
    removed = Mutation("active & ~(pdf <= pivot.arrival.limit)", "mi.Bool(active)")
    apply(monkeypatch, (removed,))
    lost, total = unlike_themselves("far_room", 100)
    print(f"{lost} of {total}")
    assert lost > 1e-3 * total


# ------------------------------ expectations elsewhere ------------------------------------------


@pytest.mark.parametrize("mutations", [1, 5, 20])
@pytest.mark.parametrize(
    ("name", "offset", "power"),
    [("room", (0, 4), 0.01), ("grooves", (0, 5), 0.01), ("far_room", (0, 4), 0.01)],
)
def test_stationarity(rgb, name, offset, power, mutations):
    report = stationarity(name, offset, mutations)
    assert_unbiased(report, f"stationarity-{name}-{mutations}", power)


@pytest.mark.parametrize("name", ["bsdfs", "emitters", "envmap", "shapes", "glossy_shapes"])
@pytest.mark.parametrize("surrogates", [0, 4])
def test_stationarity_zoo(rgb, name, surrogates):
    report = stationarity(name, (3, 2), 3, 256, surrogates=surrogates)
    assert_unbiased(report, f"stationarity-{name}-{surrogates}", 0.02)


@pytest.mark.parametrize(
    ("name", "offset"), [("room", (0, 4)), ("grooves", (0, 5)), ("far_room", (0, 4))]
)
def test_stationarity_of_surrogates(rgb, name, offset):
    report = stationarity(name, offset, 2, surrogates=5)
    assert_unbiased(report, f"stationarity-{name}-surrogates", 0.01)


def stationarity(
    name: str,
    offset: tuple[int, int],
    mutations: int,
    runs: int = 512,
    mode: Mode = FRESH,
    surrogates: int = 0,
) -> BiasReport:
    reference, _ = references.load(name)
    plan = mutation_plan(mutations, STEP, surrogates=surrogates)
    return stationarity_report(references.CASES[name], offset, runs, reference, plan, mode)


def mutating(mutations: int, frames: int = 3, **parameters: Any) -> Mode:
    return Mode(
        {
            "spatial_radius": 6.0,
            "mutations": mutations,
            "mutation_step": STEP,
            **parameters,
        },
        frames=frames,
    )


@pytest.mark.parametrize("mutations", [1, 5, 20])
@pytest.mark.parametrize("name", ["room", "grooves"])
def test_image(rgb, name, mutations):
    check(name, mutating(mutations), *ROOM)


@pytest.mark.parametrize("name", ["room", "bsdfs"])
def test_image_with_surrogates(rgb, name):
    check(name, mutating(2, mutation_surrogates=4), *ROOM)


@pytest.mark.parametrize("cap", [5.0, 50.0])
def test_caps(rgb, cap):
    check("room", mutating(5, frames=8, confidence_cap=cap), *ROOM)


@pytest.mark.parametrize("name", ["room", "grooves"])
def test_moving_camera(rgb, name):
    mode = mutating(5)
    scene = references.CASES[name].load()
    check(name, mode, *ROOM, moving_camera(scene, mode.frames), scene)


def test_light_switches_off(rgb):
    scene = references.CASES["room"].load()
    lights = [mi.Color3f(6, 5, 3.5), mi.Color3f(6, 5, 3.5), mi.Color3f(0)]
    edit = edited(scene, "light.emitter.radiance.value", lights)
    check("room_lamp_off", mutating(5, retrace_history=True), 512, 0.03, edit, scene)


def test_light_moves(rgb):
    scene = references.CASES["open_room_moved"].load()
    places = [[0.3, 1.3, 0.2], [0.1, 1.2, 0.3], references.LAMP_MOVED]
    edit = edited(scene, "lamp.position", places)
    check("open_room_moved", mutating(5, retrace_history=True), *ROOM, edit, scene)


def test_spectral(spectral):
    check("room_spectral", mutating(3), *ROOM)


# ------------------------------ the chain's own distribution ------------------------------------


def chain_scene() -> mi.Scene:
    """All pixels see the same point of a glossy floor under an environment."""
    transform = mi.ScalarTransform4f
    rng = np.random.default_rng(5)
    sky = mi.Bitmap((0.2 + rng.random((8, 16, 3))).astype(np.float32))
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": {
                "type": "perspective",
                "fov": 1e-3,
                "to_world": transform().look_at([0, -3, 3], [0, 0, 0], [0, 0, 1]),
                "film": {
                    "type": "hdrfilm",
                    "width": 160,
                    "height": 160,
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "independent"},
            },
            "floor": {
                "type": "rectangle",
                "to_world": transform().scale(3),
                "bsdf": {"type": "roughconductor", "alpha": 0.35},
            },
            "sky": {"type": "envmap", "bitmap": sky, "to_world": transform().rotate([1, 0, 0], 90)},
        }
    )


def final_states(mutations: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions (N, 3) of environment paths after a long chain, and the density's values there."""
    scene = chain_scene()
    renderer = integrator(2, Mode({"temporal": False, "spatial": False}), mutations=1)
    renderer.render(scene, seed=1, spp=1)
    scope, history = scope_of(renderer, scene, number=7, seed=8), renderer._history
    plan = mutation_plan(mutations, 0.3)
    after, mutated = mutate(scope, history.reservoirs, history.hits, plan)
    chosen = np.array(mutated.kind) == MutationClass.ON_LIGHT
    return np.array(after.path.wo).T[chosen], chosen


def expected_shares(azimuths: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Integral of the target function over cells of the hemisphere, normalised."""
    scene = chain_scene()
    fine = 32
    phi = np.linspace(azimuths[0], azimuths[-1], fine * (len(azimuths) - 1) + 1)
    z = np.linspace(heights[0], heights[-1], fine * (len(heights) - 1) + 1)
    phi, z = np.meshgrid((phi[1:] + phi[:-1]) / 2, (z[1:] + z[:-1]) / 2)
    r = np.sqrt(1 - z**2)
    d = mi.Vector3f(*(a.ravel().astype(np.float32) for a in (r * np.cos(phi), r * np.sin(phi), z)))
    origin = mi.Point3f(0, -3, 3)
    si = scene.ray_intersect(mi.Ray3f(origin, dr.normalize(mi.Point3f(0, 0, 0) - origin)))
    value, pdf = si.bsdf().eval_pdf(mi.BSDFContext(), si, si.to_local(d))
    sky = scene.ray_intersect(si.spawn_ray(d))
    ds = mi.DirectionSample3f(scene, sky, si)
    light_pdf = scene.pdf_emitter_direction(si, ds)
    radiance = ds.emitter.eval(sky)
    # C p in solid angle; only directions with a pdf within the connectability limit belong to it.
    density = mi.luminance(value * radiance) * pdf / (pdf + light_pdf)
    density = dr.select((pdf > 0) & (pdf <= 1 / 0.2**2), density, 0)
    cells = np.array(density).reshape(len(heights) - 1, fine, len(azimuths) - 1, fine)
    shares = cells.sum(axis=(1, 3))
    return shares / shares.sum()


def chain_p_value(mutations: int = 300) -> float:
    directions, _ = final_states(mutations)
    azimuths, heights = np.linspace(-np.pi, np.pi, 9), np.linspace(0, 1, 9)
    phi = np.arctan2(directions[:, 1], directions[:, 0])
    counts, _, _ = np.histogram2d(directions[:, 2], phi, bins=(heights, azimuths))
    expected = expected_shares(azimuths, heights) * counts.sum()
    common = expected > 20
    observed = np.append(counts[common], counts[~common].sum())
    wanted = np.append(expected[common], expected[~common].sum())
    wanted *= observed.sum() / wanted.sum()  # they differ by rounding only
    return float(stats.chisquare(observed, wanted).pvalue)


def test_states_have_the_histogram_of_the_target_function(rgb):
    assert chain_p_value() > 1e-4


# ------------------------------ tests of the tests ----------------------------------------------


@dataclass(frozen=True)
class Control:
    mutations: tuple[Mutation, ...]
    scene: str
    offset: tuple[int, int]
    surrogates: int = 0


CONTROLS = {
    "jacobian of what follows is one": Control(
        (
            Mutation("pdf_k * dr.select(ahead, geometry, 1)", "mi.Float(1)"),
            Mutation("dr.select(far & (next_kind_of(path) != Kind.NEE), pdf_n, 1)", "mi.Float(1)"),
        ),
        "room",
        (0, 4),
    ),
    "pdf ratio at the pivot": Control(
        (Mutation("dr.select(by_numbers, 1, pdf)", "mi.Float(1)"),), "room", (0, 4)
    ),
    "always accepted": Control(
        (Mutation("(uniform(random, i, 2) < acceptance(state, proposal))", "mi.Bool(True)"),),
        "room",
        (0, 4),
    ),
    "weight not updated": Control(
        (Mutation("weight * target(state.color) / target(proposed.color)", "mi.Float(weight)"),),
        "room",
        (0, 4),
    ),
    "connectability of the new pair": Control(
        (
            Mutation(
                "by_numbers | dr.select(onward, (pdf_k <= pair.limit) & (pdf_k > 0), pair.reaches)",
                "by_numbers | ~onward | (pdf_k > 0)",
            ),
        ),
        "far_room",
        (5, 0),
    ),
    "surrogate of the other state's plane": Control(
        (
            Mutation(
                "dr.select(same_plane(pivot, state, proposed), way_back, 0)", "mi.Float(way_back)"
            ),
        ),
        "far_room",
        (0, 4),
        surrogates=20,
    ),
}


@pytest.mark.parametrize("name", CONTROLS)
def test_control(rgb, monkeypatch, name):
    control = CONTROLS[name]
    apply(monkeypatch, control.mutations)
    report = stationarity(control.scene, control.offset, 10, surrogates=control.surrogates)
    print(f"{name}: {report}")
    assert not report.passed, f"{name} is left out, and nothing is seen\n{report}"


def test_control_of_the_histogram(rgb, monkeypatch):
    apply(monkeypatch, (Mutation("dr.select(by_numbers, 1, lobe)", "mi.Float(1)"),))
    assert chain_p_value() < 1e-6


def duplicated(path: Any) -> Any:
    """Movable paths of which a pixel nearby has another copy: a rule that reads the reservoirs."""
    lanes = dr.width(path.name.pixel)
    pixel = dr.arange(mi.UInt32, lanes)
    copies = mi.Bool(False)
    for step in (1, 2, 3, 32, 64, 96):
        for shifted in (pixel + step, pixel - step):
            inside = shifted < lanes
            other = dr.gather(mi.UInt32, path.name.pixel, shifted, inside)
            frame = dr.gather(mi.UInt32, path.name.sample, shifted, inside)
            copies |= inside & (other == path.name.pixel) & (frame == path.name.sample)
    return movable(path) & copies


def test_control_by_duplication(rgb, monkeypatch):
    """Mutating only what is duplicated reads the reservoirs, and is biased."""
    monkeypatch.setattr(proposals, "movable", duplicated)
    frames = Mode({"spatial_radius": 2.0, "spatial_rounds": 3, "temporal": False})
    report = stationarity("grooves", (0, 5), 20, 3072, frames)
    print(report)
    assert not report.passed, f"mutation decided by duplication is not seen\n{report}"


def test_statistics(rgb):
    case = references.CASES["room"]
    scene = case.load()
    renderer = integrator(case.max_depth, mutating(4))
    for seed in range(3):
        renderer.render(scene, seed=seed, spp=1)
    classes = renderer.statistics()["mutations"]
    assert sum(entry["share"] for entry in classes.values()) == pytest.approx(1)
    for name in ("before_surface", "before_light_sample", "light_numbers"):
        assert 0.05 < classes[name]["acceptance"] <= 1
    assert classes["fixed"]["acceptance"] == 0
