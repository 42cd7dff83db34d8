"""Rounds of spatial reuse: those that only show, and those that look less and less far."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
import pytest
from support import references
from support.modes import Mode
from support.runs import assert_unbiased, bias_report, independent_runs, integrator

from mitsuba_restir.integrators.parameters import Parameters
from mitsuba_restir.neighbors.strategies import layouts

pytestmark = pytest.mark.usefixtures("one_thread")

ROUNDS = {"spatial_radius": 6.0, "spatial_rounds": 3}
RUNS, POWER = 256, 0.025


def kept(scene: Any, **parameters: Any) -> list[np.ndarray]:
    """All that the history holds after three frames, and the last image."""
    renderer = integrator(5, Mode({"spatial_radius": 6.0, **parameters}))
    for _ in range(3):
        image = renderer.render(scene, seed=3, spp=1)
    arrays: list[np.ndarray] = []
    dr.schedule(renderer._history.reservoirs)
    reservoirs = renderer._history.reservoirs
    for value in (reservoirs.weight, reservoirs.confidence, reservoirs.color):
        arrays.append(np.array(value))
    return [*arrays, np.array(image)]


@pytest.fixture
def room(rgb) -> Any:
    return references.CASES["room"].load()


@pytest.mark.parametrize(
    ("feedback", "same"), [(0, {"spatial": False}), (1, {}), (2, {"spatial_rounds": 2})]
)
def test_the_history_is_that_of_the_rounds_that_it_goes_through(room, feedback, same):
    *mine, image = kept(room, spatial_rounds=3, spatial_feedback=feedback)
    *theirs, other = kept(room, **same)
    for a, b in zip(mine, theirs, strict=True):
        np.testing.assert_array_equal(a, b)
    assert np.mean(image != other) > 0.5


def test_control_one_round_more_is_another_history(room):
    *mine, _ = kept(room, spatial_rounds=3, spatial_feedback=1)
    *theirs, _ = kept(room, spatial_rounds=2)
    assert all(np.mean(a != b) > 0.1 for a, b in zip(mine, theirs, strict=True))


def test_feedback_of_all_rounds_is_the_default(room):
    for a, b in zip(kept(room, **ROUNDS), kept(room, **ROUNDS, spatial_feedback=3), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("feedback", [0, 1])
@pytest.mark.parametrize("more", [{}, {"neighbor_sampling": "blue_noise", "mutations": 2}])
def test_no_bias(rgb, feedback, more):
    case = references.CASES["room"]
    mode = Mode({**ROUNDS, "spatial_feedback": feedback, **more}, frames=4)
    runs = independent_runs(integrator(case.max_depth, mode), case.load(), mode)
    report = bias_report(runs, RUNS, *references.load("room"))
    assert_unbiased(report, f"room-feedback-{feedback}-{len(more)}", POWER)


def test_radii_shrink_to_a_pixel():
    radii = Parameters(spatial_rounds=4, spatial_radius=10.0, spatial_shrink=0.2).radii
    assert radii == pytest.approx((10.0, 2.0, 1.0, 1.0))
    assert Parameters(spatial=False).radii == ()


def test_each_round_has_the_layout_of_its_radius(rgb):
    far, near, again = layouts("random", (12.0, 3.0, 12.0))
    assert far is again
    # Of points of a disk, the mean square of the distance is half of the radius squared.
    squares = [np.square(tile.dx) + np.square(tile.dy) for tile in (far, near)]
    assert [np.sqrt(2 * np.mean(square)) for square in squares] == pytest.approx([12, 3], rel=0.1)


def test_control_equal_rounds_are_another_picture(room):
    *_, shrinking = kept(room, **ROUNDS, spatial_shrink=0.4)
    *_, equal = kept(room, **ROUNDS)
    assert np.mean(shrinking != equal) > 0.5


@pytest.mark.parametrize("strategy", ["random", "blue_noise", "geometry"])
def test_no_bias_where_rounds_shrink(rgb, strategy):
    case = references.CASES["room"]
    mode = Mode({**ROUNDS, "spatial_shrink": 0.5, "neighbor_sampling": strategy}, frames=3)
    runs = independent_runs(integrator(case.max_depth, mode), case.load(), mode)
    report = bias_report(runs, RUNS, *references.load("room"))
    assert_unbiased(report, f"room-shrink-{strategy}", POWER)
