"""Guided candidates keep every pixel's expectation, whatever the guide says.

The guides here are adversaries: random, zero over half of the sphere, with random shares, and the
same for all frames, so that nothing averages out. Each factor of a candidate's weight is left out
once, and is missed.
"""

from __future__ import annotations

import functools
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats
from support import references, rooms
from support.modes import MODES, Mode
from support.mutants import Mutation, apply
from support.runs import bias_report, independent_runs, integrator
from test_unbiased import ROOM, ZOO, check

from mitsuba_restir.guiding import guide as guides
from mitsuba_restir.guiding import policy, share
from mitsuba_restir.guiding.cells import CELLS
from mitsuba_restir.guiding.guide import LEVELS, Guide, no_guide
from mitsuba_restir.guiding.roulette import Expected, nothing_expected
from mitsuba_restir.sampling.streams import FrameKey, Purpose

pytestmark = pytest.mark.usefixtures("one_thread")


def tree(leaves: np.ndarray) -> list[np.ndarray]:
    """Sums of the trees with these leaves (cells, 2^LEVELS)."""
    levels = [leaves.astype(np.float32).ravel()]
    for _ in range(LEVELS):
        levels.insert(0, levels[0].reshape(-1, 2).sum(axis=-1))
    return levels


@functools.cache
def hostile() -> list[np.ndarray]:
    """Random lobes over a half of the sphere, another one in every cell; a quarter is empty."""
    rng = np.random.default_rng(5)
    leaves = rng.exponential(size=(CELLS, 1 << LEVELS)) ** 3
    halves = leaves.reshape(CELLS, 2, -1)
    halves[np.arange(CELLS), rng.integers(2, size=CELLS)] = 0
    leaves[rng.random(CELLS) < 0.25] = 0
    return tree(leaves)


def adversary() -> Guide:
    """A guide that has learnt nothing of the scene."""
    sums = hostile()
    share = np.random.default_rng(6).uniform(0.2, 0.9, CELLS)
    alpha = np.where(sums[0] > 0, share, 1)
    return replace(no_guide(), sums=[mi.Float(level) for level in sums], alpha=mi.Float(alpha))


@pytest.fixture
def frozen(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    monkeypatch.setattr(policy, "no_guide", adversary)
    monkeypatch.setattr(policy, "learn", lambda _, guide, *__: guide)
    return monkeypatch


# --------------------------------- the guide alone ----------------------------------------------


def test_samples_follow_the_density(rgb):
    """Directions of a random cell, by leaves: chi-square at 1e-4; the density integrates to one."""
    rng = np.random.default_rng(1)
    leaves = np.zeros((CELLS, 1 << LEVELS))
    leaves[3] = rng.exponential(size=1 << LEVELS) ** 2
    leaves[3, rng.random(1 << LEVELS) < 0.5] = 0
    sums = [mi.Float(level) for level in tree(leaves)]
    guide = Guide(sums, mi.Float(1), mi.Float(0), mi.Float(0))
    n = 1 << 20
    lane, all_lanes = dr.arange(mi.UInt32, n), dr.full(mi.Bool, True, n)
    cell = mi.UInt32(3) + 0 * lane
    random = FrameKey(mi.UInt32(1), mi.UInt32(2)).stream(Purpose.INITIAL, lane)
    direction = guides.sample(guide, cell, random, mi.UInt32(1), all_lanes)
    np.testing.assert_allclose(np.array(dr.norm(direction)), 1, atol=1e-5)
    found = np.bincount(np.array(guides.leaf_of(direction)), minlength=1 << LEVELS)
    density = np.array(guides.pdf(guide, cell, direction, all_lanes))
    share = leaves[3] / leaves[3].sum()
    wanted = (1 - guides.UNIFORM) * share + guides.UNIFORM / (1 << LEVELS)
    assert stats.chisquare(found, wanted * n).pvalue > 1e-4
    number = np.array(guides.leaf_of(direction))
    np.testing.assert_allclose(density, (wanted * (1 << LEVELS) / (4 * np.pi))[number], rtol=1e-4)


def test_what_is_learnt_adds_up(rgb):
    """All sums are those of their children, and the guide knows what was found."""
    scene = references.CASES["room"].load()
    renderer = integrator(5, MODES["both"], guiding=True)
    for i in range(8):
        renderer.render(scene, seed=i, spp=1)
    sums = [np.array(level) for level in renderer._history.learnt.guide.sums]
    assert 20 < np.count_nonzero(sums[0]) < CELLS
    for level, found in zip(sums, tree(sums[-1]), strict=True):
        np.testing.assert_allclose(level, found, rtol=1e-4)


@pytest.mark.parametrize("light", [0.02, 0.3, 0.9])
def test_the_share_is_the_cheapest(rgb, light):
    """Directions of two classes, of which BSDF and guide draw the second with 0.1 and 0.9."""
    rng = np.random.default_rng(2)
    f, p, g = np.array([1 - light, light]), np.array([0.9, 0.1]), np.array([0.1, 0.9])
    drawn_with = 0.7 * p + 0.3 * g
    drawn = rng.choice(2, 20_000, p=drawn_with)
    cost = mi.Float(((f / drawn_with) ** 2 * drawn_with / p)[drawn])
    bills, cell = share.nothing_paid(), dr.full(mi.UInt32, 7, len(drawn))
    share.pay(bills, cell, cost, mi.Float((g / p)[drawn]), mi.Bool(True))
    costs = share.settled(dr.zeros(mi.Float, CELLS * guides.COSTS), 1.0, bills)
    alpha = np.array(share.cheapest(costs, dr.arange(mi.UInt32, CELLS) == 7))
    moments = [np.sum(f**2 / (a * p + (1 - a) * g)) for a in share.SHARES]
    assert alpha[7] == np.float32(share.SHARES[np.argmin(moments)])
    assert (np.delete(alpha, 7) == 1).all()


def test_a_cell_that_has_seen_little_trusts_the_bsdf(rgb):
    bills = share.nothing_paid()
    share.pay(bills, mi.UInt32(7), mi.Float(1), mi.Float(2), mi.Bool(True))
    costs = share.settled(dr.zeros(mi.Float, CELLS * guides.COSTS), 1.0, bills)
    assert (np.array(share.cheapest(costs, mi.Bool(True))) == 1).all()


def test_reset_forgets_the_guide(rgb, two_threads):
    scene, sensor = references.CASES["room"].load(), rooms.large_sensor()
    renderer = integrator(5, MODES["both"], guiding=True)
    runs = []
    for _ in range(2):
        renderer.reset()
        runs.append([np.array(renderer.render(scene, sensor, seed=i, spp=1)) for i in range(3)])
    np.testing.assert_array_equal(runs[0], runs[1])


# --------------------------------- expectations -------------------------------------------------

CASES = {
    "room": ("candidates_4", *ROOM),
    "grooves": ("candidates_4", 256, 0.06),
    "far_room": ("candidates_4", 256, 0.08),
    "bsdfs": ("candidates_4", ZOO["bsdfs"][0], 0.04),
    "emitters": ("candidates_4", ZOO["emitters"][0], 0.1),
    "glossy_shapes": ("candidates_4", ZOO["glossy_shapes"][0], 0.05),
}


@pytest.mark.parametrize("deep", [guides.DEEP, 1000], ids=["", "deep"])
@pytest.mark.parametrize("name", CASES)
def test_an_adversary_is_unbiased(rgb, frozen, name, deep):
    frozen.setattr(guides, "DEEP", deep)
    mode, runs, power = CASES[name]
    check(name, mode, runs, power, label=f"{name}-adversary-{deep}", guiding=True)


@pytest.mark.parametrize("mode", ["spatial_1", "temporal", "both", "both_reconnection"])
def test_an_adversary_in_every_reuse(rgb, frozen, mode):
    check("room", mode, 256, 0.05, label=f"room-adversary-{mode}", guiding=True)


TOGETHER = {
    "mutations": {"mutations": 2},
    "dithered and ranked": {"blue_noise_seeds": True, "neighbor_sampling": "blue_noise"},
    "retraced": {"retrace_history": True},
}


@pytest.mark.parametrize("name", TOGETHER)
def test_together_with(rgb, name):
    mode = replace(MODES["both"], frames=6)
    check("room", mode, 256, 0.03, label=f"room-guided-{name}", guiding=True, **TOGETHER[name])


def test_learnt_in_independent_frames(rgb):
    """Without history the guide still learns; all frames count."""
    check(
        "room", Mode({"temporal": False, "spatial_radius": 6.0}, frames=4), 256, 0.04, guiding=True
    )


# --------------------------------- roulette -----------------------------------------------------


def misled() -> Expected:
    """Expects anything, another thing in every cell, and nothing in a quarter of them."""
    rng = np.random.default_rng(8)
    radiance = 10 ** rng.uniform(-2, 2, CELLS) * (rng.random(CELLS) > 0.25)
    return replace(nothing_expected(), radiance=mi.Float(radiance))


@pytest.fixture
def misleading(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    monkeypatch.setattr(policy, "nothing_expected", misled)
    monkeypatch.setattr(policy, "updated", lambda expected, *_: expected)
    return monkeypatch


@pytest.mark.parametrize("guiding", [False, True])
@pytest.mark.parametrize("name", CASES)
def test_roulette_by_any_expectation(rgb, frozen, misleading, name, guiding):
    mode, runs, power = CASES[name]
    label = f"{name}-roulette-{guiding}"
    check(name, mode, runs, 1.5 * power, label=label, guiding=guiding, roulette="contribution")


def test_roulette_by_what_is_learnt(rgb):
    mode = replace(MODES["both"], frames=6)
    check("room", mode, 256, 0.03, label="room-roulette", guiding=True, roulette="contribution")


def test_expectations_meet_the_light_that_leaves(rgb):
    """In a furnace every surface sends out what it is lit by, whatever ends the paths."""
    wall = {"type": "diffuse", "reflectance": 0.5}
    scene = mi.load_dict(
        {
            "type": "scene",
            "sensor": {
                "type": "perspective",
                "film": {"type": "hdrfilm", "width": 32, "height": 32, "rfilter": {"type": "box"}},
            },
            "room": {
                "type": "sphere",
                "radius": 2.0,
                "flip_normals": True,
                "bsdf": wall,
                "light": {"type": "area", "radiance": 1.0},
            },
        }
    )
    renderer = mi.load_dict(
        {"type": "restir_pt", "max_depth": -1, "roulette": "contribution", "guiding": True}
    )
    for seed in range(400):
        renderer.render(scene, seed=seed, spp=4)
    expected = renderer._history.learnt.expected
    visits = np.array(expected.sums)[1::2]
    mean = np.average(np.array(expected.radiance), weights=visits)
    # Scattered light alone: 0.5 + 0.25 + ... of a unit radiance.
    assert mean == pytest.approx(1, rel=0.02)


CONTROLS = {
    "factor of a stored direction": Mutation(
        "stored = dr.select(chosen.delta, alpha, alpha + (1 - alpha) * ratio)",
        "stored = 1 + 0 * alpha",
    ),
    "factor of a replayed bounce": Mutation(
        "replayed = dr.select(leaves, 0, alpha)", "replayed = dr.select(leaves, 0, mi.Float(1))"
    ),
    "refusal of a guided prefix": Mutation(
        "replayed = dr.select(leaves, 0, alpha)", "replayed = dr.select(leaves, alpha, alpha)"
    ),
}


def test_control_of_roulette(rgb, misleading):
    apply(misleading, (Mutation("survival *= chance", "survival *= 1"),))
    case = references.CASES["grooves"]
    more = {"roulette": "contribution"}
    renderer = integrator(case.max_depth, MODES["candidates_4"], **more)
    runs = independent_runs(renderer, case.load(), MODES["candidates_4"])
    report = bias_report(runs, 128, *references.load("grooves"))
    assert not report.passed, f"what paths survive is left out, and nothing is seen\n{report}"


@pytest.mark.parametrize("name", CONTROLS)
def test_control(rgb, frozen, name):
    apply(frozen, (CONTROLS[name],))
    case = references.CASES["grooves"]
    renderer = integrator(case.max_depth, MODES["candidates_4"], guiding=True)
    runs = independent_runs(renderer, case.load(), MODES["candidates_4"])
    report = bias_report(runs, 256, *references.load("grooves"))
    assert not report.passed, f"{name} is left out, and nothing is seen\n{report}"


def test_spectral(spectral):
    check("room_spectral", "both", 64, 0.06, guiding=True)
