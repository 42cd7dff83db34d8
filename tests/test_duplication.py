"""Duplicated paths: the count against a plain double loop, and what makes two paths the same."""

from __future__ import annotations

import numpy as np
import pytest
from support import references
from support.modes import Mode
from support.runs import integrator
from support.scopes import mutate, mutation_plan, scope_of
from test_decorrelate import STEP

from mitsuba_restir.analysis.duplication import NO_PATH, copies, duplicated_share
from mitsuba_restir.paths.identity import BITS, identity

# ------------------------------ counting --------------------------------------------------------


@pytest.mark.parametrize("shape", [(9, 14), (1, 7), (5, 1)])
@pytest.mark.parametrize("radius", [1, 2, 8])
def test_copies_against_a_double_loop(shape, radius):
    ids = np.random.default_rng(radius).integers(NO_PATH, 12, shape)
    expected = np.zeros(shape, dtype=int)
    for y, x in np.ndindex(shape):
        window = ids[max(y - radius, 0) : y + radius + 1, max(x - radius, 0) : x + radius + 1]
        expected[y, x] = (window == ids[y, x]).sum() - 1 if ids[y, x] != NO_PATH else 0
    np.testing.assert_array_equal(copies(ids, radius), expected)
    paths = ids != NO_PATH
    assert duplicated_share(ids, radius) == pytest.approx((expected[paths] > 0).mean())


def test_share_of_known_images():
    different = np.arange(20 * 30).reshape(20, 30)
    assert duplicated_share(different) == 0.0
    assert duplicated_share(np.zeros((20, 30), dtype=int)) == 1.0
    assert duplicated_share(np.full((20, 30), NO_PATH)) == 0.0
    far = different.copy()
    far[10, 4], far[10, 13] = 1000, 1000  # nine pixels apart
    assert duplicated_share(far, 8) == 0.0
    assert duplicated_share(far, 9) == pytest.approx(2 / 600)


def test_bad_input():
    with pytest.raises(ValueError, match="two-dimensional array of integers"):
        copies(np.zeros((4, 4)))
    with pytest.raises(ValueError, match="radius is 0"):
        copies(np.zeros((4, 4), dtype=int), 0)


# ------------------------------ identity of paths -----------------------------------------------


def test_identity_of_mutated_paths(rgb):
    """It changes where a mutation was accepted, and only there."""
    case = references.CASES["bsdfs"]
    renderer = integrator(case.max_depth, Mode({"temporal": False, "spatial": False}), mutations=1)
    renderer.render(scene := case.load(), seed=3, spp=1)
    before, hits = renderer._history.reservoirs, renderer._history.hits
    scope = scope_of(renderer, scene, number=1, seed=2)
    after, mutated = mutate(scope, before, hits, mutation_plan(3, STEP))
    old, new = np.array(identity(before.path)), np.array(identity(after.path))
    moved = np.array(mutated.accepted) > 0
    assert 100 < moved.sum() < moved.size
    np.testing.assert_array_equal(old != new, moved)
    lit = np.array(before.weight) > 0
    assert old.max() < 2**BITS
    assert len(np.unique(old[lit])) >= lit.sum() - 1  # one collision is possible


def test_identity_of_shared_paths(rgb):
    """Spatial reuse makes copies, whose factors differ from pixel to pixel; mutations undo it."""
    case = references.CASES["room"]
    scene = case.load()
    shares = {}
    for mutations in (0, 3):
        mode = Mode({"spatial_radius": 4.0, "mutations": mutations, "mutation_step": STEP})
        renderer = integrator(case.max_depth, mode, aovs="path:path")
        for seed in range(6):
            image = np.array(renderer.render(scene, seed=seed, spp=1))
        before, after, shown = np.moveaxis(image[..., 3:].astype(int), -1, 0)
        shares[mutations] = [duplicated_share(ids) for ids in (before, after, shown)]
        np.testing.assert_array_equal(shown == NO_PATH, (image[..., :3] == 0).all(axis=-1))
    print(shares)
    assert shares[0][0] == shares[0][1] > 0.2
    assert shares[3][1] < 0.5 * shares[3][0]
    assert shares[3][1] < shares[3][2] < shares[0][2]
