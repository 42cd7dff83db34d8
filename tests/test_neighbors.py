"""Neighbours by rank: exchanges are permutations, the error is bluer, and nothing is biased."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats
from support import references, rooms
from support.bias import BiasReport
from support.modes import MODES, Mode
from support.mutants import Mutation, apply
from support.pixels import image_of, lanes_of
from support.runs import assert_unbiased, bias_report, independent_runs, integrator
from support.scopes import scope_of

from mitsuba_restir.analysis.spectrum import band_power, power_spectrum
from mitsuba_restir.integrators import frame as frame_module
from mitsuba_restir.neighbors.groups import NOWHERE, Groups, scattered_groups, surface_labels
from mitsuba_restir.neighbors.ranked import expected_confidence
from mitsuba_restir.neighbors.ranks import rank_pixels, turned
from mitsuba_restir.neighbors.strategies import STRATEGIES
from mitsuba_restir.passes.spatial import Merged, spatial
from mitsuba_restir.paths.grid import grid_of
from mitsuba_restir.paths.spectrum import target
from mitsuba_restir.resampling.pairwise import Sharing, canonical_share, merge, pull, push
from mitsuba_restir.sampling.dither import mask_texture
from mitsuba_restir.sampling.masks import load_mask, void_and_cluster, white
from mitsuba_restir.sampling.streams import FrameKey, Purpose, uniform

pytestmark = pytest.mark.usefixtures("one_thread")

ALPHA = 1e-4
OTHERS = ("white_noise", "blocks", "geometry")


def choices(seed: int) -> Any:
    return FrameKey(mi.UInt32(0), mi.UInt32(seed)).stream(Purpose.NEIGHBORS, 0)


def by_mask_level(image: np.ndarray, ranks: np.ndarray) -> np.ndarray:
    """The pixels in another order: 4 x 4 blocks of pixels with like levels of the mask."""
    height, width = image.shape[:2]
    order = np.argsort(ranks[:height, :width].ravel())
    rows, columns = height // 4, width // 4
    blocks = image.reshape(height * width, -1)[order].reshape(rows, columns, 4, 4, -1)
    return blocks.transpose(0, 2, 1, 3, 4).reshape(image.shape)


def report(
    scene_name: str,
    mode: Mode,
    runs: int,
    sampling: str = "blue_noise",
    sort: bool = False,
    **parameters: Any,
) -> BiasReport:
    case = references.CASES[scene_name]
    renderer = integrator(case.max_depth, mode, neighbor_sampling=sampling, **parameters)
    images = independent_runs(renderer, case.load(), mode)
    reference, variance = references.load(scene_name)
    if sort:
        ranks = load_mask()
        images = (by_mask_level(image, ranks) for image in images)
        reference, variance = (by_mask_level(image, ranks) for image in (reference, variance))
    return bias_report(images, runs, reference, variance)


def luminances(reservoirs: Any) -> Any:
    return target(reservoirs.color) * reservoirs.weight


def hashes(reservoirs: Any) -> Any:
    """Numbers that know nothing of the paths."""
    number = reservoirs.path.name.sample
    pixel = dr.arange(mi.UInt32, dr.width(number))
    return uniform(FrameKey(number, mi.UInt32(1)).stream(Purpose.SPATIAL, pixel), 0, 0)


def two_sided(
    sharing: Sharing, reservoirs: Any, layout: Any, draws: Any, values: Any
) -> list[tuple[Any, Any]]:
    """The picks of ``ranked`` by these values, for rules that need both shifts."""
    labels = surface_labels(sharing.hits, draws)
    dr.eval(labels, values)
    grid = sharing.scope.grid
    ranks = rank_pixels(grid, layout, labels, values, reservoirs.confidence, draws)
    dr.eval(ranks)
    k = sharing.neighbors
    return [(ranks.source(mi.UInt32(j), k), ranks.count > 1) for j in range(k)]


def exchanged(sharing: Sharing, reservoirs: Any, other: Any, valid: Any) -> tuple[Any, Any]:
    theirs = pull(sharing, reservoirs, other, valid, mi.Bool(False))
    reach, _ = push(sharing, reservoirs, other, valid)
    dr.eval(theirs, reach)
    return theirs, dr.select(valid, canonical_share(sharing, reservoirs, reach), 0)


def chained(
    by: Any, sharing: Sharing, strategy: Any, layout: Any, reservoirs: Any, number: Any
) -> Merged:
    """The same picks, merged one after the other: each against what the one before has left."""
    key, pixel = sharing.scope.key, sharing.scope.grid.pixels()
    draws = key.stream(Purpose.NEIGHBORS, number)
    picks = two_sided(sharing, reservoirs, layout, draws, by(reservoirs))
    single = replace(sharing, neighbors=1)
    for j, (other, valid) in enumerate(picks):
        theirs, share = exchanged(single, reservoirs, other, valid)
        confidence = 2 * reservoirs.confidence
        turn = FrameKey(key.sample, key.seed ^ (mi.UInt32(j + 1) << 24))
        selection = turn.stream(Purpose.SPATIAL, pixel)
        reservoirs, color, pairs = merge(reservoirs, [theirs], [share], confidence, selection)
        dr.eval(reservoirs, color)
    return Merged(reservoirs, color, pairs, [])


def without_the_empty(
    sharing: Sharing, strategy: Any, layout: Any, reservoirs: Any, number: Any
) -> Merged:
    """The same picks, but a pixel without a path is nobody's neighbour."""
    key, pixel = sharing.scope.key, sharing.scope.grid.pixels()
    draws = key.stream(Purpose.NEIGHBORS, number)
    values = luminances(reservoirs)
    picks = two_sided(sharing, reservoirs, layout, draws, values)
    pairs = [
        exchanged(sharing, reservoirs, other, valid & (dr.gather(mi.Float, values, other) > 0))
        for other, valid in picks
    ]
    selection = key.stream(Purpose.SPATIAL, pixel)
    pulled, shares = ([pair[i] for pair in pairs] for i in range(2))
    return Merged(*merge(reservoirs, pulled, shares, reservoirs.confidence, selection), [])


# --------------------------------- the exchange --------------------------------------------------


def synthetic(
    values: np.ndarray, groups: Groups, seed: int, labels: Any = None, confidence: Any = None
) -> Any:
    height, width = values.shape
    labels = np.zeros(values.shape) if labels is None else labels
    confidence = np.ones(values.shape) if confidence is None else confidence
    ranks = rank_pixels(
        grid_of(width, height),
        groups,
        mi.UInt32(lanes_of(labels).astype(np.uint32)),
        mi.Float(lanes_of(values).astype(np.float32)),
        mi.Float(lanes_of(confidence).astype(np.float32)),
        choices(seed),
    )
    dr.eval(ranks)
    return ranks


@pytest.fixture(scope="module")
def blue() -> np.ndarray:
    return load_mask()


@pytest.mark.parametrize("neighbors", [1, 2, 3, 5, 32])
@pytest.mark.parametrize(("height", "width", "radius"), [(37, 50, 6.0), (1, 40, 20.0), (9, 9, 1.0)])
def test_every_path_is_taken_as_often_as_paths_are_asked_for(rgb, height, width, radius, neighbors):
    rng = np.random.default_rng(0)
    labels = rng.integers(3, size=(height, width)).astype(np.uint32)
    labels[rng.random(labels.shape) < 0.1] = NOWHERE
    # Many ties, as where no path was found.
    values = np.maximum(rng.normal(size=labels.shape), 0)
    groups = scattered_groups(mask_texture(void_and_cluster(32, 0)), radius)
    ranks = synthetic(values, groups, 5, labels)
    n = height * width
    pixel = np.arange(n)
    used = lanes_of(labels) != NOWHERE
    count = np.array(ranks.count)
    assert np.array_equal(count > 0, used)
    slots, takers = [], []
    for j in range(neighbors):
        source = np.array(ranks.source(mi.UInt32(j), neighbors))
        assert np.array_equal(lanes_of(labels)[source[used]], lanes_of(labels)[used])
        slots.append(source)
        taker, slot = ranks.taker(j, neighbors)
        takers.append((np.array(taker), np.array(slot)))
    slots = np.array(slots)
    taken = np.bincount(slots[:, used].ravel(), minlength=n)
    assert np.array_equal(taken[used], np.full(used.sum(), neighbors))
    edges = set()
    for taker, slot in takers:
        assert np.array_equal(slots[slot[used], taker[used]], pixel[used])
        edges |= set(zip(taker[used].tolist(), slot[used].tolist(), strict=True))
    assert len(edges) == neighbors * used.sum()


def test_a_pixel_takes_one_path_of_each_stratum_in_the_order_of_the_mask(rgb, blue):
    rng = np.random.default_rng(1)
    values = rng.lognormal(size=(64, 80))
    ranks = synthetic(values, scattered_groups(mask_texture(blue), 20.0), 2)
    picks = np.stack(
        [lanes_of(values)[np.array(ranks.source(mi.UInt32(j), 3))] for j in range(3)], axis=-1
    )
    first, mask, count = (np.array(a) for a in (ranks.first, ranks.mask, ranks.count))
    assert count.max() == 81
    order = np.lexsort((mask, first))
    same = np.diff(first[order]) == 0
    assert (np.diff(picks[order], axis=0)[same] >= 0).all()
    # Each pick's rank in its class, as a share of it: one in each third, up to a rank.
    for begin in np.unique(first):
        inside = first == begin
        place = np.searchsorted(np.sort(lanes_of(values)[inside]), picks[inside]) / inside.sum()
        offset = 3 * place - np.arange(3)
        assert offset.min() > -3 / inside.sum() - 1e-9
        assert offset.max() < 1


@pytest.mark.parametrize("cells", [2, 5, 16])
@pytest.mark.parametrize("kinds", [1, 3, 64 * 64])
def test_ranks_are_those_of_a_sort_in_groups_of_every_size(rgb, blue, cells, kinds):
    """Up to the largest, in which all members are alike, or none."""
    rng = np.random.default_rng(3)
    values = rng.permutation(64 * 64).reshape(64, 64)
    labels = rng.permutation(64 * 64).reshape(64, 64) % kinds
    ranks = synthetic(values, Groups(mask_texture(blue), cells, 1), 7, labels)
    first, value, mask, count = (
        np.array(a).astype(int) for a in (ranks.first, ranks.value, ranks.mask, ranks.count)
    )
    if kinds == 1:
        assert count.max() == cells**2
    if kinds == values.size:
        assert count.max() == 1
    for begin in np.unique(first):
        inside = first == begin
        assert len(np.unique(lanes_of(labels)[inside])) == 1
        members = np.arange(inside.sum())
        assert (count[inside] == inside.sum()).all()
        order = np.argsort(lanes_of(values)[inside])
        assert np.array_equal(value[inside][order], members)
        assert np.array_equal(np.sort(mask[inside]), members)


@pytest.mark.parametrize("count", [1, 2, 7, 81])
def test_turned_ranks_are_a_permutation_and_uniform(rgb, count):
    rank = dr.arange(mi.UInt32, count)
    results = np.array([np.array(turned(rank, mi.UInt32(count), choices(s))) for s in range(99)])
    results = results.astype(int)
    assert np.array_equal(np.sort(results, axis=1), np.tile(np.arange(count), (99, 1)))
    # Many seeds at once: one rank, one turn per lane.
    many = np.array(turned(mi.UInt32(count // 3), mi.UInt32(count), lanes_of_choices(40_000)))
    assert stats.chisquare(np.bincount(many, minlength=count)).pvalue > ALPHA or count == 1
    # Ranks that meet on the circle stay alike.
    assert np.abs(np.diff(results, axis=1)).max(initial=0) <= 2


def lanes_of_choices(lanes: int) -> Any:
    return FrameKey(mi.UInt32(0), dr.arange(mi.UInt32, lanes)).stream(Purpose.NEIGHBORS, 0)


def test_the_error_of_the_picks_is_bluer_by_a_blue_mask(rgb, blue):
    """Power of the mean of three picks, on a field of independent values of variance 1."""
    rng = np.random.default_rng(2)
    powers = {}
    for name, ranks in (("blue", blue), ("white", white(256, 0))):
        groups = scattered_groups(mask_texture(ranks), 20.0)
        errors = []
        for seed in range(12):
            values = rng.exponential(size=(192, 192))
            exchange = synthetic(values, groups, seed)
            picks = [np.array(exchange.source(mi.UInt32(j), 3)) for j in range(3)]
            found = lanes_of(values)[np.array(picks)].mean(axis=0)
            errors.append(image_of(found, 192, 192) - 1)
        powers[name] = band_power(power_spectrum(np.array(errors)), [(0.02, 0.06), (0.06, 0.17)])
    # Independent picks have the power 1/3.
    assert powers["white"][1] < 0.25
    assert powers["blue"][1] < 0.55 * powers["white"][1], powers
    assert powers["blue"][0] < 0.8 * powers["white"][0], powers


# --------------------------------- expectation --------------------------------------------------

SPATIAL_1 = Mode({"temporal": False, "spatial_radius": 6.0})
SPATIAL_3 = Mode({**SPATIAL_1.parameters, "spatial_rounds": 3, "spatial_neighbors": 2})
BOTH = MODES["both"]
# Relative error of the image that a test of 128 runs finds with probability 0.99.
# One block of `emitters` lives on a rare, bright path, which 128 runs may not have, and in `room` a
# firefly may take the power of so few.
RUNS = {"emitters": 768, "room": 192}
POWER = {
    "room": 0.03,
    "emitters": 0.065,
    "envmap": 0.025,
    "glossy_shapes": 0.025,
    "bsdfs": 0.025,
    "sunsky": 0.035,
    "shapes": 0.025,
}


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        ("room", SPATIAL_1),
        ("room", SPATIAL_3),
        ("room", BOTH),
        ("emitters", SPATIAL_1),
        ("emitters", BOTH),
        ("envmap", BOTH),
        ("glossy_shapes", SPATIAL_1),
        ("bsdfs", BOTH),
        ("sunsky", SPATIAL_1),
        ("shapes", BOTH),
    ],
    ids=lambda x: x if isinstance(x, str) else f"{x.frames}",
)
def test_unbiased(rgb, name, mode):
    assert_unbiased(report(name, mode, RUNS.get(name, 128)), f"{name}-blue_noise", POWER[name])


@pytest.mark.parametrize(("name", "mode"), [("room", BOTH), ("emitters", SPATIAL_1)])
@pytest.mark.parametrize("sampling", OTHERS)
def test_others_are_unbiased(rgb, name, sampling, mode):
    result = report(name, mode, RUNS.get(name, 128), sampling)
    assert_unbiased(result, f"{name}-{sampling}", POWER[name])


FIXED_MASK = Mutation(
    "level = groups.mask.level(x, y, key)", "level = groups.mask.level(x, y, mi.UInt32(0))"
)
FIXED_TURN = Mutation(
    "rank = rank + dr.mul_hi(word, count)", "rank = rank + dr.mul_hi(mi.UInt32(0), count)"
)


@pytest.mark.parametrize(
    ("mutations", "passes"),
    [((), True), ((FIXED_MASK,), True), ((FIXED_MASK, FIXED_TURN), False)],
    ids=["random", "fixed mask", "fixed mask and turn"],
)
@pytest.mark.parametrize("name", ["room", "emitters"])
def test_the_turn_makes_it_unbiased(rgb, monkeypatch, name, mutations, passes):
    """The bias of a mask that stays is in the pixels of like levels; the turn alone removes it."""
    apply(monkeypatch, mutations)
    result = report(name, SPATIAL_1, 128, sort=True)
    assert result.passed == passes, result


@pytest.mark.parametrize(
    ("rule", "name", "passes"),
    [
        (partial(chained, luminances), "room", False),
        (partial(chained, hashes), "room", True),
        (without_the_empty, "emitters", False),
    ],
    ids=["chain", "chain that knows no values", "pool"],
)
def test_rules_that_look_at_values_are_biased(rgb, monkeypatch, name, rule, passes):
    """Controls: the picks of ranks in a chain of merges; a pool that depends on the paths."""
    monkeypatch.setattr(frame_module, "spatial", rule)
    assert report(name, SPATIAL_1, 128).passed == passes


# --------------------------------- confidence ---------------------------------------------------


def feedback(groups: Groups, own: bool, frames: int) -> np.ndarray:
    """What a next frame gets of two picks beyond their expectation, one mean per frame.

    Of the pixels, 80 % are new: confidence 1 and the value 1/0.3 with probability 0.3, else 0. The
    others have confidence 20 and the value 1. A history of confidence M counts with M/(M + 1), so
    that the mean of M/(M + 1) (value - 1) is the bias of a next frame.
    """
    rng = np.random.default_rng(4)
    size = (96, 96)
    result = []
    for seed in range(frames):
        fresh = rng.random(size) < 0.8
        values = np.where(fresh, (rng.random(size) < 0.3) / 0.3, 1.0)
        confidence = np.where(fresh, 1.0, 20.0)
        ranks = synthetic(values, groups, seed, confidence=confidence)
        picks = np.array([np.array(ranks.source(mi.UInt32(j), 2)) for j in range(2)])
        m = lanes_of(confidence)
        if own:
            handed_on = m + m[picks].sum(axis=0)
        else:
            handed_on = np.array(expected_confidence(mi.Float(m.astype(np.float32)), ranks, 2))
        mean = lanes_of(values)[picks].mean(axis=0)
        result.append(np.mean(handed_on / (handed_on + 1) * (mean - 1)))
    return np.array(result)


@pytest.mark.parametrize("own", [False, True], ids=["expected", "own"])
def test_confidence_of_the_picks_would_be_biased(rgb, blue, own):
    """The picks' own confidence goes with their ranks: handing it on is the control (-2.8 %)."""
    excess = feedback(scattered_groups(mask_texture(blue), 20.0), own, 48)
    p = stats.ttest_1samp(excess, 0).pvalue
    assert (p < ALPHA) == own, (excess.mean(), p)


@pytest.mark.parametrize("sampling", ["blue_noise", "blocks", "geometry"])
def test_confidence_does_not_depend_on_the_values(rgb, sampling):
    """The same G-buffer with other paths: candidates of another depth."""
    scene = references.CASES["room"].load()
    images = []
    for depth in (2, 5):
        renderer = integrator(depth, SPATIAL_1, neighbor_sampling=sampling)
        renderer.render(scene, seed=1, spp=1)
        images.append(np.array(renderer._history.reservoirs.confidence))
    np.testing.assert_array_equal(*images)
    assert images[0].max() > 3


# --------------------------------- frames -------------------------------------------------------


@pytest.mark.parametrize("sampling", STRATEGIES)
def test_frames_repeat_and_are_not_compiled_again(rgb, two_threads, sampling):
    scene, sensor = references.CASES["room"].load(), rooms.large_sensor()
    renderer = integrator(5, BOTH, neighbor_sampling=sampling, spatial_rounds=2)
    frames = [np.array(renderer.render(scene, sensor, seed=s, spp=1)) for s in range(2)]
    renderer.reset()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        again = [np.array(renderer.render(scene, sensor, seed=s, spp=1)) for s in range(4)]
        history = dr.kernel_history([dr.KernelType.JIT])
    np.testing.assert_array_equal(again[:2], frames)
    assert all(np.isfinite(image).all() and image.min() >= 0 for image in again)
    assert history
    assert all(entry["cache_hit"] for entry in history)


# The groups of ranks are made for a radius, and a round with another one is another recording.
@pytest.mark.parametrize(
    ("sampling", "shrink"),
    [(name, 0.5 if name in ("random", "geometry") else 1.0) for name in STRATEGIES],
)
def test_frames_and_rounds_share_their_recordings(rgb, sampling, shrink):
    scene = references.CASES["room"].load()
    radii = {"spatial_rounds": 3, "spatial_radius": 12.0, "spatial_shrink": shrink}
    renderer = integrator(5, BOTH, neighbor_sampling=sampling, **radii)
    recordings = []
    for seed in range(3):
        mi.render(scene, integrator=renderer, seed=seed, spp=1)
        recordings.append([stage._recorded.n_recordings for stage in renderer._stages.all])
    assert np.max(recordings) == 1, recordings


@pytest.mark.parametrize("name", ["emitters", "grooves"])
@pytest.mark.parametrize("sampling", ["blue_noise", "geometry"])
def test_reservoirs_stay_valid(rgb, name, sampling):
    case = references.CASES[name]
    renderer = integrator(case.max_depth, BOTH, neighbor_sampling=sampling)
    scene = case.load()
    for seed in range(8):
        renderer.render(scene, seed=seed, spp=1)
        reservoirs = renderer._history.reservoirs
        for value in (reservoirs.weight, reservoirs.color, reservoirs.confidence):
            assert np.isfinite(np.array(value)).all()
            assert np.array(value).min() >= 0


def test_bad_value_says_what_is_allowed(rgb):
    with pytest.raises(RuntimeError, match="random, blue_noise, white_noise, blocks, geometry"):
        mi.load_dict({"type": "restir_pt", "neighbor_sampling": "psychic"})


@pytest.mark.parametrize("sampling", STRATEGIES)
def test_the_mean_of_the_pair_estimators_is_the_pixel(rgb, sampling):
    """It is the colour shown, and its luminance the sum of the resampling weights."""
    renderer = integrator(5, Mode({"temporal": False, "spatial": False}))
    scene = references.CASES["room"].load()
    renderer.render(scene, seed=3, spp=1)
    before = renderer._history
    sharing = Sharing(scope_of(renderer, scene, number=5, seed=5), before.hits, 3)
    strategy = STRATEGIES[sampling]
    after = spatial(sharing, strategy, strategy.layout(6.0), before.reservoirs, mi.UInt32(5))
    merged, color, pairs = after.reservoirs, after.color, after.estimators
    used = np.stack([np.broadcast_to(np.array(valid), 32 * 32) for valid in pairs.valid])
    values = np.stack([np.array(value) for value in pairs.colors])
    assert used[0].all()
    assert used.sum(0).max() == len(values) == 4
    mean = (values * used[:, None]).sum(0) / used.sum(0)
    np.testing.assert_allclose(mean, np.array(color), rtol=1e-4, atol=1e-6)
    weights = np.array(target(merged.color) * merged.weight)
    np.testing.assert_allclose(weights, np.array(target(color)), rtol=1e-4, atol=1e-6)
