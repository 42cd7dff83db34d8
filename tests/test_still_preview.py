"""Previews of stills: bluer than the mean so far, as bright as it, and never part of it.

Estimates of a wall are made up: frames of known mean, independent, at little cost.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats
from support import references
from support.wall import HEIGHT, WIDTH, color, hits_of

from mitsuba_restir import scenes
from mitsuba_restir.analysis.spectrum import TABLE_BANDS, band_power, power_spectrum
from mitsuba_restir.paths.grid import grid_of
from mitsuba_restir.resampling.pairwise import PairEstimators
from mitsuba_restir.resampling.subsets import Round
from mitsuba_restir.still import accumulate, checkpoint, driver, growth, preview
from mitsuba_restir.still.accumulate import Layout
from mitsuba_restir.still.frames import Frames, Subject, previewed
from mitsuba_restir.still.goal import Goal
from mitsuba_restir.still.growth import Growth
from mitsuba_restir.still.pilot import Choice
from mitsuba_restir.still.plan import Plan
from mitsuba_restir.still.preview import Added, Estimated, Preview, Steering

SIGMA = 0.8
PAIRS = 3
COUNTS = (1, 4, 16)
CHAINS = 4
LEVEL = 0.999
"""Of one-sided tests, by Student's interval of the chains' ratios; seeds are fixed."""

LAYOUT = Layout(3, ((0, 1, 2),), ())

MIXED = Plan("mixed", 1, {"spatial_rounds": 2, "spatial_radius": 8.0})


@pytest.fixture
def wall(rgb) -> Iterator[Any]:
    hits, scene = hits_of()
    yield hits
    del scene


@dataclass
class Made:
    """A still of made-up frames, and its preview."""

    hits: Any
    steered: Preview
    sums: Any = None
    frames: int = 0

    def add(self, values: np.ndarray) -> None:
        """One frame: estimates (PAIRS + 1, HEIGHT, WIDTH)."""
        sums = self.sums or accumulate.nothing(LAYOUT, (HEIGHT, WIDTH))
        self.frames += 1
        count = dr.opaque(mi.Float, self.frames)
        grey = values.mean(0).astype(np.float32)
        image = mi.Float(np.repeat(grey.ravel(), 3))
        after = accumulate.add(LAYOUT, sums, [], image, count)
        valid = [dr.ones(mi.Bool, WIDTH * HEIGHT) for _ in values]
        dr.make_opaque(valid)
        rounds = [Round(color(grey), PairEstimators([color(v) for v in values], valid))]
        picture = after.picture
        added = Added(image, [], picture.mean, picture.products, count)
        self.steered.add(Estimated(self.hits, rounds), added, sums.picture.mean)
        self.sums = after

    @property
    def mean(self) -> np.ndarray:
        return accumulate.image_of(self.sums.picture.mean, (HEIGHT, WIDTH))

    @property
    def shown(self) -> np.ndarray:
        return self.steered.picture(self.sums)


def made(hits: Any, steered: Preview | None = None) -> Made:
    return Made(hits, steered or Preview(Steering(LAYOUT, (HEIGHT, WIDTH), SIGMA)))


def drawn(rng: np.random.Generator, lit: float, shape: float) -> np.ndarray:
    """Estimates of mean one: some are lit, and these gamma-distributed."""
    values = rng.gamma(shape, 1 / (shape * lit), (PAIRS + 1, HEIGHT, WIDTH))
    return values * (rng.random(values.shape) < lit)


# ------------------------------ what is gained --------------------------------------------------


def powers(hits: Any, lit: float, shape: float, chains: int = CHAINS) -> np.ndarray:
    """Power in .06-.17 of the preview's error over the mean's, (chains, len(COUNTS))."""
    found = np.empty((chains, len(COUNTS)))
    steered = Preview(Steering(LAYOUT, (HEIGHT, WIDTH), SIGMA))
    for chain in range(chains):
        rng = np.random.default_rng(chain)
        still = made(hits, steered.another())
        for _ in range(max(COUNTS)):
            still.add(drawn(rng, lit, shape))
            if still.frames in COUNTS:
                shown, plain = (
                    band_power(power_spectrum(image[..., 1] - 1), TABLE_BANDS[1:])[0]
                    for image in (still.shown, still.mean)
                )
                found[chain, COUNTS.index(still.frames)] = shown / plain
    return found


def reach(ratios: np.ndarray) -> np.ndarray:
    """Half of the interval of each mean."""
    half = stats.t.ppf(LEVEL, len(ratios) - 1) / np.sqrt(len(ratios))
    return half * ratios.std(axis=0, ddof=1)


@pytest.mark.parametrize(
    ("lit", "shape", "bounds"), [(1.0, 2.0, (0.5, 0.3, 0.3)), (0.15, 1.0, (0.9, 0.5, 0.4))]
)
def test_the_error_is_blue(wall, lit, shape, bounds):
    ratios = powers(wall, lit, shape)
    print(ratios.mean(axis=0), reach(ratios))
    assert (ratios.mean(axis=0) + reach(ratios) < bounds).all()


def test_control_of_estimates_at_random_it_is_not(wall, monkeypatch):
    """Any of the same candidates, whatever it is: the band gains nothing after any number."""

    def any_of(grid: Any, key: Any, rounds: Any, aim: Any) -> mi.Color3f:
        (known,) = rounds
        pixel = grid.pixels() + 31 * key.sample
        which = mi.sample_tea_32(pixel, mi.UInt32(7))[0] % (PAIRS + 1)
        color = mi.Color3f(0)
        for i, g in enumerate(known.estimators.colors):
            color = dr.select(which == i, known.mean + (known.mean - g) / PAIRS, color)
        return color

    monkeypatch.setattr(preview, "choose", any_of)
    ratios = powers(wall, 1.0, 2.0, chains=12)
    print(ratios.mean(axis=0), reach(ratios))
    assert (ratios.mean(axis=0) - reach(ratios) > 1.0).all()


def test_an_edge_stays_where_it_is(wall):
    """Half of the wall has a tenth of the light, beside it: neither side takes any of the other."""
    rng, still = np.random.default_rng(1), made(wall)
    light = np.where(np.arange(WIDTH) < WIDTH // 2, 1.0, 0.1)
    for _ in range(16):
        still.add(light * drawn(rng, 1.0, 2.0))
    for column in (WIDTH // 2 - 1, WIDTH // 2):
        shown, plain = (image[:, column, 1].mean() for image in (still.shown, still.mean))
        assert shown == pytest.approx(plain, rel=0.05)


# ------------------------------ what is shown ---------------------------------------------------


@pytest.mark.parametrize(("lit", "shape", "first"), [(1.0, 2.0, 1e-5), (0.15, 1.0, 0.05)])
def test_it_is_as_bright_as_the_mean(wall, lit, shape, first):
    """Exactly; of the first frames of rare light as far as the factor goes that makes it so."""
    rng, still = np.random.default_rng(2), made(wall)
    for frame in range(6):
        still.add(drawn(rng, lit, shape))
        print(still.shown.mean() / still.mean.mean())
        tolerance = first if frame < 3 else 1e-5
        assert still.shown.mean() == pytest.approx(still.mean.mean(), rel=tolerance)
        assert (still.shown != still.mean).any()


def test_it_is_a_mean_of_the_frames_estimates(wall):
    """The factor of the brightness apart, pixels are between means of extremes; at first one of
    the means without one or two estimates, or the plain mean."""
    rng, still = np.random.default_rng(3), made(wall)
    low, high = np.zeros((2, HEIGHT, WIDTH))
    for frame in range(4):
        values = drawn(rng, 1.0, 2.0)
        low, high = low + values.min(0), high + values.max(0)
        still.add(values)
        shown = grid_of(WIDTH, HEIGHT).image(np.array(still.steered._shown)[1])
        if frame == 0:
            subsets = [s for s in range(1, 16) if bin(s).count("1") >= 2]
            means = [
                values[[i for i in range(PAIRS + 1) if subset >> i & 1]].mean(0)
                for subset in subsets
            ]
            nearest = np.abs(np.stack(means) - shown).min(axis=0)
            assert nearest.max() < 1e-5 * values.max()
    tolerance = 1e-5 * high
    assert (shown >= low / 4 - tolerance).all()
    assert (shown <= high / 4 + tolerance).all()


def made_with(hits: Any, value: float, light: list[tuple[float, float]], at: int) -> Made:
    """Frames of such light (see `drawn`); in one of them a pixel has this value."""
    rng, still = np.random.default_rng(4), made(hits)
    for frame, (lit, shape) in enumerate(light):
        values = drawn(rng, lit, shape)
        if frame == at:
            values[:, 20, 30] = value
        still.add(values)
    return still


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_pixel_that_is_not_finite_is_shown_and_no_other(wall, value):
    still = made_with(wall, value, [(0.15, 1.0)] * 5, at=1)
    lost = ~np.isfinite(still.shown).all(axis=2)
    assert lost[20, 30]
    assert lost.sum() == 1
    assert (still.shown != still.mean)[:, 60:].any()
    assert still.shown[~lost].mean() == pytest.approx(still.mean[~lost].mean(), rel=1e-5)


def test_around_a_pixel_that_is_not_finite_the_choice_goes_on(wall):
    """As without it, but for what would have been chosen at it."""
    around = np.zeros((HEIGHT, WIDTH), bool)
    around[12:29, 22:39] = True
    around[20, 30] = False
    steered = []
    for value in (1.0, np.nan):
        still = made_with(wall, value, [(1.0, 2.0)] * 3, at=0)
        shown = grid_of(WIDTH, HEIGHT).image(np.array(still.steered._shown)[1])
        steered.append((np.abs(shown - still.mean[..., 1]) > 1e-3)[around].mean())
    assert steered[1] == pytest.approx(steered[0], abs=0.02)


def test_black_is_black(wall):
    still = made(wall)
    for _ in range(2):
        still.add(np.zeros((PAIRS + 1, HEIGHT, WIDTH)))
    assert not still.shown.any()


# ------------------------------ the still -------------------------------------------------------


@pytest.fixture
def room(rgb) -> mi.Scene:
    return references.CASES["room"].load()


def frames_of(scene: mi.Scene, sigma: float | None, plan: Plan = MIXED) -> Frames:
    subject = Subject(scene, scene.sensors()[0], 3, {"max_depth": 4}, previewed=sigma)
    return Frames(subject, plan)


def test_nothing_of_it_reaches_the_still(room, tmp_path, monkeypatch):
    """Bit by bit: picture, statistics, mixture, what is learnt, and the file to go on from."""
    unlike = {"alone": 0.0, "with": 0.0}
    plan = replace(MIXED, parameters={**MIXED.parameters, "guiding": True})
    monkeypatch.setattr(growth, "mixture", thirds)
    kept = []
    for name, sigma in zip(unlike, (None, SIGMA), strict=True):
        still = Growth(frames_of(room, sigma, plan), "", lambda: 0.0)
        for _ in still.grow(Goal(frames=6)):
            pass
        path = tmp_path / name
        checkpoint.save(path, {}, still)
        result = still.still()
        kept.append((result.image, result.standard_error, path.read_bytes()))
        unlike[name] = float(np.abs(still.shown() - still.picture()).max())
    for alone, beside in zip(*kept, strict=True):
        np.testing.assert_array_equal(alone, beside)
    assert unlike["alone"] == 0.0
    assert unlike["with"] > 0.0


def thirds(covariance: np.ndarray, frames: int) -> np.ndarray:
    """Weights that mix all estimates."""
    return np.full(covariance.shape[1:], 1 / len(covariance))


def test_it_begins_anywhere(room, tmp_path):
    """A still that goes on from a checkpoint is what it would have been, and so is its preview's
    mean; the preview itself begins with the mean."""
    whole = Growth(frames_of(room, SIGMA), "", lambda: 0.0)
    for now in whole.grow(Goal(frames=6)):
        if now.frames == 3:
            checkpoint.save(tmp_path / "a", {}, whole)
    source = frames_of(room, SIGMA)
    rest = Growth(
        source,
        "",
        lambda: 0.0,
        checkpoint.take_up(checkpoint.load(tmp_path / "a", {}, None), source),
    )
    np.testing.assert_array_equal(rest.shown(), rest.picture())
    for _ in rest.grow(Goal(frames=6)):
        pass
    np.testing.assert_array_equal(rest.picture(), whole.picture())
    assert (rest.shown() != rest.picture()).any()
    assert rest.shown().mean() == pytest.approx(whole.picture().mean(), rel=1e-5)


def test_rounds_are_kept_from_whenever_they_are_asked_for(room):
    renderer = mi.load_dict({"type": "restir_pt", **MIXED.parameters})
    renderer.render(room, spp=1)
    assert not renderer.frame.rounds
    renderer.keep_rounds()
    renderer.render(room, spp=1)
    assert len(renderer.frame.rounds) == 2


def test_each_still_of_the_same_frames_has_its_own(room):
    frames = frames_of(room, SIGMA)
    still = Growth(frames, "", lambda: 0.0)
    next(still.grow(Goal(frames=2)))
    shown = still.shown()
    other = Growth(frames, "", lambda: 0.0)
    np.testing.assert_array_equal(still.shown(), shown)
    np.testing.assert_array_equal(other.shown(), other.picture())
    assert (shown != still.picture()).any()


def test_without_reuse_the_mean_is_shown(room):
    still = Growth(frames_of(room, SIGMA, Plan("bare", 2, {"spatial": False})), "", lambda: 0.0)
    for _ in still.grow(Goal(frames=2)):
        pass
    np.testing.assert_array_equal(still.shown(), still.picture())


@pytest.mark.parametrize(
    ("given", "sigma"),
    [
        ({}, None),
        ({"blue_noise": "none", "blue_noise_sigma": 1.0}, None),
        ({"blue_noise": "selection"}, SIGMA),
        ({"blue_noise": "selection", "blue_noise_sigma": 1.0}, 1.0),
    ],
)
def test_it_is_asked_for_by_the_parameters_of_selection(given, sigma):
    assert previewed(given) == sigma


@pytest.mark.parametrize("name", ["room_mono", "room_spectral"])
def test_in_other_variants(request, name):
    """With auxiliary images and a denoiser's guides beside: finite, and the mean is the same."""
    case = references.CASES[name]
    request.getfixturevalue(name.removeprefix("room_"))
    scene = case.load()
    grown = []
    for sigma in (None, SIGMA):
        given = {"max_depth": 4}
        subject = Subject(
            scene, scene.sensors()[0], 3, given, {"z": "depth"}, guides=True, previewed=sigma
        )
        still = Growth(Frames(subject, MIXED), "", lambda: 0.0)
        for _ in still.grow(Goal(frames=3)):
            pass
        grown.append(still)
    alone, beside = grown
    np.testing.assert_array_equal(beside.picture(), alone.picture())
    np.testing.assert_array_equal(beside.still().aovs["z"], alone.still().aovs["z"])
    assert np.isfinite(beside.shown()).all()
    assert (beside.shown() != beside.picture()).any()
    assert beside.shown().mean() == pytest.approx(beside.picture().mean(), rel=1e-4)


def test_the_pilots_frames_are_recorded_for_it_and_none_is_steered(room, monkeypatch):
    """Nor is any of them in the picture."""

    def quick(begin: Any, goal: Any, trial: Any) -> Choice:
        begin(MIXED)(1)
        return Choice(MIXED, "it was the first", 0.0)

    recorded: list[Plan] = []

    def watched(subject: Subject, plan: Plan) -> Frames:
        recorded.append(plan)
        return Frames(subject, plan)

    monkeypatch.setattr(driver, "pilot", quick)
    monkeypatch.setattr(driver, "Frames", watched)
    pictures = []
    for sigma in (None, SIGMA):
        subject = frames_of(room, sigma).subject
        still = driver.begun(subject, None, Goal(frames=3), lambda: 0.0)
        for _ in still.grow(Goal(frames=3)):
            pass
        pictures.append(still.picture())
    np.testing.assert_array_equal(*pictures)
    assert recorded == [MIXED, MIXED]
    assert (still.shown() != still.picture()).any()


def peak_of(scene: mi.Scene, sigma: float | None) -> float:
    """Dr.Jit's peak in a frame [bytes a pixel]."""
    frames = frames_of(scene, sigma, Plan("view", 1, {}))
    steps = Growth(frames, "", lambda: 0.0).grow(Goal(frames=9))
    for _ in range(3):
        next(steps)
    dr.sync_thread()
    gc.collect()
    dr.flush_malloc_cache()
    dr.detail.malloc_clear_statistics()
    next(steps)
    assert not frames._integrator.frame.rounds
    return float(dr.detail.malloc_watermark(dr.backend_v(mi.Float)) / np.prod(frames.size))


def test_what_is_chosen_from_is_not_kept(rgb):
    """With all that the choice calculates kept to its end the peak was 2.1 times that without."""
    scene = scenes.load("cornell", 128, 128)
    plain, steered = peak_of(scene, None), peak_of(scene, SIGMA)
    print(plain, steered)
    assert 1.0 < steered / plain < 1.85


def test_nothing_is_compiled_again(room, monkeypatch):
    """Through decisions of a still, and from one to the next."""
    monkeypatch.setattr(growth, "mixture", thirds)
    frames = frames_of(room, SIGMA)
    for seed, count in enumerate((6, 10)):
        frames.restart(seed)
        still = Growth(frames, "", lambda: 0.0)
        for _ in still.grow(Goal(frames=count)):
            still.shown()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        for _ in Growth(frames, "", lambda: 0.0).grow(Goal(frames=10)):
            pass
        history = dr.kernel_history([dr.KernelType.JIT])
    missed = [kernel for kernel in history if not kernel["cache_hit"]]
    assert history
    assert not missed, f"{len(missed)} of {len(history)} kernels were compiled again"
