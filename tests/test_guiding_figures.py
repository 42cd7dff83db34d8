"""What is seen of guided candidates: their own image, and figures of the guide at work."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from support import references
from support.modes import MODES
from support.runs import integrator

from mitsuba_restir import scenes
from mitsuba_restir.guiding import figures
from mitsuba_restir.guiding.cells import CELLS, cells_of
from mitsuba_restir.guiding.guide import no_guide
from mitsuba_restir.guiding.share import SHARES


def rendered(frames: int, mode: str = "both", **parameters: Any) -> tuple[list[np.ndarray], Any]:
    """All frames (H, W, channels) of one history in the room, and their renderer."""
    scene = references.CASES["room"].load()
    renderer = integrator(5, MODES[mode], **parameters)
    return [np.array(renderer.render(scene, seed=3, spp=2)) for _ in range(frames)], renderer


@pytest.mark.parametrize("parameters", [{}, {"mutations": 2}], ids=["plain", "mutations"])
def test_the_image_of_candidates_is_that_of_frames_without_reuse(rgb, parameters):
    shown = {"aovs": "own:candidates", **parameters}
    reused, _ = rendered(4, **shown)
    # Paths that are mutated are rounded otherwise, and mutated where they are shown.
    plain, _ = rendered(4, "candidates_1", **shown)
    own = [frame[..., 3:] for frame in plain]
    np.testing.assert_array_equal([frame[..., 3:] for frame in reused], own)
    if not parameters:
        np.testing.assert_array_equal([frame[..., :3] for frame in plain], own)
    assert np.abs(reused[-1][..., :3] - own[-1]).max() > 0.1


def test_the_image_of_candidates_costs_nothing_where_it_is_not_asked_for(rgb):
    for aovs, width in (("", 1), ("depth", 1), ("candidates", 32 * 32)):
        _, renderer = rendered(2, aovs=aovs)
        assert dr.width(renderer.frame.beside.candidates) == width


def test_light_is_the_share_of_pixels_whose_candidates_carry_some(rgb):
    """``candidates_1`` shows nothing else, and no light is in view."""
    frames, renderer = rendered(3, "candidates_1")
    share = float(np.mean(frames[-1].max(axis=-1) > 0))
    assert 0 < share < 1
    assert renderer.statistics()["light"] == pytest.approx(share)
    _, renderer = rendered(3, "both")
    assert renderer.statistics()["light"] == pytest.approx(share)


def test_a_guide_finds_more_light(rgb):
    scene = scenes.load("ajar", 128, 72)
    plain, guided = (integrator(8, MODES["both"], guiding=guiding) for guiding in (False, True))
    for renderer in (plain, guided):
        for seed in range(24):
            renderer.render(scene, seed=seed, spp=1)
    assert "guiding" not in plain.statistics()
    statistics = guided.statistics()
    assert statistics["light"] > 1.1 * plain.statistics()["light"]
    assert 0 < statistics["guiding"]["cells"] < 1
    assert min(SHARES) <= statistics["guiding"]["alpha"] < 1


def test_figures_of_a_guide_that_is_known(rgb):
    """A quarter of the table, then all of it; the room is diffuse, so that all of it is guided."""
    _, renderer = rendered(1)
    hit, nothing = renderer._history.hits, no_guide()
    cells = cells_of(references.CASES["room"].load())
    assert figures.cells_in_use(nothing) == 0
    assert figures.mean_share_of_bsdf(cells, nothing, hit) == 1
    roots = np.zeros(CELLS, np.float32)
    roots[::4] = 1
    assert figures.cells_in_use(replace(nothing, sums=[mi.Float(roots)])) == 0.25
    everywhere = replace(
        nothing, sums=[dr.ones(mi.Float, CELLS)], alpha=dr.full(mi.Float, 0.7, CELLS)
    )
    assert figures.cells_in_use(everywhere) == 1
    assert figures.mean_share_of_bsdf(cells, everywhere, hit) == pytest.approx(0.7)
