"""Guiding with everything else: modes, variants, cameras, edits, selection, and long histories."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from support import references, rooms
from support.modes import MODES, Mode
from support.mutants import Mutation, apply
from support.runs import bias_report, independent_runs, integrator
from test_guiding import frozen  # noqa: F401  (a fixture)
from test_selection import words
from test_unbiased import CHANGING, RETRACING, ZOO, check, edited, moving_camera

from mitsuba_restir.guiding.learn import learn
from mitsuba_restir.guiding.steering import ByGuide
from mitsuba_restir.integrators import frame as frame_module

pytestmark = pytest.mark.usefixtures("one_thread")

# --------------------------------- expectations -------------------------------------------------


@pytest.mark.parametrize("mode", MODES)
def test_an_adversary_in_every_mode(rgb, frozen, mode):  # noqa: F811
    check("room", mode, 128, 0.045, label=f"room-adversary-{mode}", guiding=True)


@pytest.mark.long
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", ["room", "grooves", *ZOO])
def test_long(rgb, frozen, name, mode):  # noqa: F811
    check(name, mode, 2048, 0.04, label=f"{name}-adversary-long-{mode}", guiding=True)


def test_an_adversary_in_monochrome(mono, frozen):  # noqa: F811
    check("room_mono", "both", 128, 0.03, label="room-adversary-mono", guiding=True)


@pytest.mark.long
def test_an_adversary_in_spectra(spectral, frozen):  # noqa: F811
    check("room_spectral", "both", 64, 0.05, label="room-adversary-spectral", guiding=True)


def test_a_lens(rgb):
    check(
        "room_lens",
        Mode(MODES["both"].parameters, frames=5),
        128,
        0.035,
        label="lens-guided",
        guiding=True,
    )


@pytest.mark.parametrize("name", ["room", "grooves"])
def test_moving_camera(rgb, name):
    scene = references.CASES[name].load()
    mode = Mode(MODES["both"].parameters, frames=5)
    check(name, mode, 128, 0.04, moving_camera(scene, 5), scene, f"{name}-moving", guiding=True)


@pytest.mark.parametrize("mode", RETRACING)
def test_light_moves(rgb, mode):
    scene = references.CASES["open_room_moved"].load()
    places = [[0.3, 1.3, 0.2], [0.1, 1.2, 0.3], references.LAMP_MOVED]
    edit = edited(scene, "lamp.position", places)
    label = f"moved-guided-{mode}"
    check("open_room_moved", RETRACING[mode], 128, CHANGING[1], edit, scene, label, guiding=True)


# --------------------------------- controls -----------------------------------------------------


def found(name: str) -> bool:
    """Whether a bias is seen in guided candidates."""
    case, mode = references.CASES[name], MODES["candidates_4"]
    runs = independent_runs(integrator(case.max_depth, mode, guiding=True), case.load(), mode)
    return not bias_report(runs, 128, *references.load(name)).passed


def test_alpha_of_the_wrong_vertex_is_seen(rgb, frozen):  # noqa: F811
    factor = "ratio = dr.select(chosen.pdf > 0, g / chosen.pdf, 0)"
    elsewhere = "alpha_at(guide, cell_at(self.cells, si.p + 0.37, si.n), vertex, usable)"
    apply(frozen, (Mutation(factor, f"{factor}; alpha = {elsewhere}"),))
    assert found("room")


def test_learning_from_what_is_drawn_is_seen(rgb, monkeypatch):
    """The frame's own samples teach the guide first, and then are drawn with it."""
    drawn = frame_module.initial

    def peeking(scope, hit, spp, policy, continued):
        steering = policy.steering
        assert isinstance(steering, ByGuide)
        early = drawn(scope, hit, spp, policy, continued).reservoirs
        dr.eval(early)
        guide = learn(steering.cells, steering.guide, early, hit, 1.0)
        guide.alpha = dr.select(guide.sums[0] > 0, mi.Float(0.5), 1)
        dr.eval(guide)
        policy = replace(policy, steering=replace(steering, guide=guide))
        return drawn(scope, hit, spp, policy, continued)

    monkeypatch.setattr(frame_module, "initial", peeking)
    assert found("room")


# --------------------------------- histories ----------------------------------------------------


def test_confidence_is_the_number_of_trees(rgb):
    """Guided or not: what is found does not count."""
    scene = references.CASES["room"].load()
    renderers = [integrator(5, MODES["both"], guiding=guiding) for guiding in (False, True)]
    for seed in range(6):
        confidences = []
        for renderer in renderers:
            renderer.render(scene, seed=seed, spp=2)
            confidences.append(np.array(renderer._history.reservoirs.confidence))
        np.testing.assert_array_equal(*confidences)


def test_selection_leaves_reservoirs_and_guide_alone(rgb):
    scene = references.CASES["room"].load()
    parameters = {"guiding": True, "mutations": 2, "neighbor_sampling": "blue_noise"}
    histories = []
    for shown in ("none", "selection"):
        renderer = integrator(5, MODES["both"], blue_noise=shown, **parameters)
        for seed in range(5):
            renderer.render(scene, seed=seed, spp=1)
        histories.append(renderer._history)
    own, other = histories
    for a, b in zip(words(own.reservoirs), words(other.reservoirs), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(own.learnt.guide.sums[-1], other.learnt.guide.sums[-1])


def test_another_scene_forgets_the_guide(rgb):
    room, other = references.CASES["room"].load(), references.CASES["open_room_moved"].load()
    used, new = (integrator(5, MODES["both"], guiding=True) for _ in range(2))
    for seed in range(3):
        used.render(room, seed=seed, spp=1)
    for renderer in (used, new):
        for seed in range(2):
            renderer.render(other, seed=seed, spp=1)
    known = [np.array(renderer._history.learnt.guide.sums[-1]) > 0 for renderer in (used, new)]
    assert known[1].any()
    np.testing.assert_array_equal(*known)


@pytest.mark.slow
@pytest.mark.parametrize("parameters", [{}, {"retrace_history": True, "mutations": 1}])
def test_five_hundred_frames(rgb, parameters):
    """Nothing that is not finite, no memory that grows."""
    description = rooms.sensor()
    description["film"] |= {"width": 16, "height": 16}
    scene, sensor = references.CASES["room"].load(), mi.load_dict(description)
    renderer = integrator(5, MODES["both"], guiding=True, **parameters)

    def peak(first: int, last: int) -> int:
        dr.detail.malloc_clear_statistics()
        for seed in range(first, last):
            image = np.array(renderer.render(scene, sensor=sensor, seed=seed, spp=1))
            assert np.isfinite(image).all(), seed
            assert image.min() >= 0, seed
        for value in (renderer._history.learnt.guide.sums[0], renderer._history.reservoirs.weight):
            assert np.isfinite(np.array(value)).all()
        return dr.detail.malloc_watermark(dr.JitBackend.LLVM)

    peak(0, 20)
    early = peak(20, 120)
    assert peak(120, 500) <= early


def test_repeats_are_equal_bit_by_bit(rgb, two_threads):
    scene, sensor = references.CASES["room"].load(), rooms.large_sensor()
    renderer = integrator(5, MODES["both"], guiding=True, roulette="contribution")
    repeats = []
    for _ in range(4):
        renderer.reset()
        frames = [renderer.render(scene, sensor=sensor, seed=i, spp=1) for i in range(5)]
        repeats.append([np.array(frame) for frame in frames])
    for other in repeats[1:]:
        np.testing.assert_array_equal(repeats[0], other)
