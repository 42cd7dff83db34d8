"""Mutations of the n-th part of the pixels: which have their turn, and that the others stay."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from support import references
from support.modes import Mode
from support.runs import integrator
from support.scopes import mutate, mutation_plan, scope_of
from test_decorrelate import STEP, mutating
from test_unbiased import ROOM, check

from mitsuba_restir.mutations.schedule import mutate_in_turns, pixels_of_set, stride
from mitsuba_restir.paths.grid import grid_of

pytestmark = pytest.mark.usefixtures("one_thread")

FRESH = Mode({"temporal": False, "spatial": False})


@pytest.mark.parametrize("size", [(320, 18), (33, 7), (5, 3)])
@pytest.mark.parametrize("interval", [2, 3, 4, 7])
def test_every_pixel_has_one_turn(rgb, size, interval):
    turns = np.zeros(size[0] * size[1], dtype=int)
    for turn in range(9, 9 + interval):
        pixel, inside = pixels_of_set(grid_of(*size), interval, dr.opaque(mi.UInt32, turn))
        np.add.at(turns, np.array(pixel)[np.array(inside)], 1)
    assert (turns == 1).all()


def test_strides_spread_the_sets():
    """Squared distances of the best lattices with n points per unit cell, by hand."""
    assert [stride(n) for n in (1, 2, 3, 4, 5, 8)] == [0, 1, 1, 2, 2, 3]


def test_only_the_set_is_mutated(rgb):
    """Its pixels get what they get where all are mutated; the others keep every bit."""
    case = references.CASES["bsdfs"]
    scene = case.load()
    renderer = integrator(case.max_depth, FRESH, mutations=1)
    renderer.render(scene, seed=3, spp=1)
    before, hits = renderer._history.reservoirs, renderer._history.hits
    size = scene.sensors()[0].film().crop_size()
    scope, plan = scope_of(renderer, scene, number=1, seed=2), mutation_plan(5, STEP, interval=3)
    everywhere, _ = mutate(scope, before, hits, plan)
    turn = dr.opaque(mi.UInt32, 5)
    pixel, inside = pixels_of_set(scope.grid, 3, turn)
    there = np.zeros(size[0] * size[1], dtype=bool)
    there[np.array(pixel)[np.array(inside)]] = True
    some, mutated = mutate_in_turns(scope, before, hits, plan, turn)
    assert len(np.array(mutated.kind)) == len(np.array(pixel))
    changed = 0
    for old, new, all_new in zip(_arrays(before), _arrays(some), _arrays(everywhere), strict=True):
        np.testing.assert_array_equal(new[..., ~there], old[..., ~there])
        np.testing.assert_array_equal(new[..., there], all_new[..., there])
        changed += int((new != old).any())
    assert changed > 6


def _arrays(reservoirs: Any) -> list[np.ndarray]:
    path = reservoirs.path
    fields = [path.name.pixel, path.info, path.vertex.place, path.vertex.surface, path.next.leaving]
    fields += [path.leaving, path.radiance, path.light_pdf, path.factor]
    fields += [reservoirs.color, reservoirs.weight, reservoirs.confidence]
    return [np.array(field) for field in fields]


@pytest.mark.parametrize("name", ["room", "grooves"])
def test_image(rgb, name):
    check(name, mutating(5, mutation_interval=2), *ROOM)


def test_statistics_count_the_set_alone(rgb):
    case = references.CASES["room"]
    renderer = integrator(case.max_depth, mutating(3, mutation_interval=3))
    scene = case.load()
    for seed in range(3):
        renderer.render(scene, seed=seed, spp=1)
        classes = renderer.statistics()["mutations"]
        assert sum(entry["share"] for entry in classes.values()) == pytest.approx(1)
        assert 0.5 < classes["light_numbers"]["acceptance"] <= 1


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"mutation_interval": 0}, "mutation_interval must be an integer from 1 to 64, not 0"),
        (
            {"mutation_acceptance": "energy", "mutations": 1, "mutation_interval": 2},
            "mutation_acceptance='energy' mutates every pixel in every frame and needs "
            "mutation_interval=1, not 2",
        ),
    ],
)
def test_bad_parameters(rgb, parameters, message):
    with pytest.raises(RuntimeError, match=message):
        mi.load_dict({"type": "restir_pt", **parameters})
