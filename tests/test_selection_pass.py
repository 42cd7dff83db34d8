"""Selection shows one of the pixel's own estimates, makes the error blue, and keeps the mean.

The tests run the pass on made-up estimates of a wall, whose mean is known and whose frames are
independent: thousands of frames' worth of pixels at little cost. Bounds of the bias are stated in
``FIELDS``; the controls, each with a piece left out, must exceed them.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields, replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats
from support.mutants import Mutation, apply
from support.pixels import image_of, lanes_of, order
from support.wall import HEIGHT, WIDTH, color, hits_of

from mitsuba_restir.analysis.spectrum import TABLE_BANDS, band_power, power_spectrum
from mitsuba_restir.neighbors import color_history
from mitsuba_restir.neighbors.around import (
    OFFSETS,
    local_mean,
    similar_further,
    similar_neighbors,
    spaced_pixels,
)
from mitsuba_restir.neighbors.color_history import ColorHistory, no_color_history
from mitsuba_restir.neighbors.reproject import Motion
from mitsuba_restir.neighbors.similarity import similar
from mitsuba_restir.passes import select
from mitsuba_restir.paths.grid import grid_of
from mitsuba_restir.resampling.pairwise import PairEstimators
from mitsuba_restir.resampling.subsets import Round, candidates
from mitsuba_restir.sampling.streams import FrameKey, Purpose, uniform2
from mitsuba_restir.shifts.scope import Scope

pytestmark = pytest.mark.usefixtures("one_thread")

SIZE = (WIDTH, HEIGHT)
PAIRS = 3
SIGMA = 1.0
WARMUP, FRAMES, BATCH = 70, 300, 60
ERRORS = 5.0
"""Standard errors between an estimated bias and its bound, by 5 batches of frames that are about as
long as the history's memory: on either side of the bound a bias just at it would be missed once in
270 tests. Seeds are fixed."""


NOWHERE = Scope(*[None] * len(fields(Scope)))
"""Selection wants to know the grid and the frame only."""


# --------------------------------- made-up frames -------------------------------------------------


@pytest.fixture
def wall(rgb):
    hits, scene = hits_of()
    yield hits
    del scene


@pytest.fixture
def edges(rgb):
    """The wall, and a sheet in front of its left half."""
    place = mi.ScalarTransform4f().translate([-1.5, 0, 1.5]).scale([1.5, 10, 1])
    hits, scene = hits_of({"type": "rectangle", "to_world": place})
    yield hits
    del scene


def image(values):
    """(HEIGHT, WIDTH, 3) array of a ``Color3f``."""
    return np.stack([image_of(channel, WIDTH, HEIGHT) for channel in values], axis=-1)


def key(sample, seed):
    return FrameKey(dr.opaque(mi.UInt32, sample), dr.opaque(mi.UInt32, seed))


def neighborhoods(hits):
    """Similar neighbours, and those twice as far away."""
    alike = similar_neighbors(grid_of(*SIZE), hits)
    return alike, similar_further(grid_of(*SIZE), alike)


def everywhere(count=PAIRS + 1):
    valid = [dr.ones(mi.Bool, WIDTH * HEIGHT) for _ in range(count)]
    dr.make_opaque(valid)
    return valid


def chosen(hits, mean, estimators, reference, sample=0):
    alike, _ = neighborhoods(hits)
    grid = grid_of(*SIZE)
    aim = select.Aim(reference, alike, SIGMA)
    return image(select.choose(grid, key(sample, 1), [Round(mean, estimators)], aim))


def pixels_of_set(index, order):
    number = select.set_in_turn(mi.UInt32(index), order)
    return spaced_pixels(grid_of(*SIZE), select.SPACING, number)


def random_frame(shape=0.5, valid=None):
    """Estimates (4, 3, HEIGHT, WIDTH), their mean and a history, of gamma noise around one."""
    rng = np.random.default_rng(0)
    values = rng.gamma(shape, 1 / shape, (PAIRS + 1, 3, HEIGHT, WIDTH)).astype(np.float32)
    used = np.ones((PAIRS + 1, HEIGHT, WIDTH), bool) if valid is None else valid
    values = np.where(used[:, None], values, 0)
    reference = rng.gamma(20.0, 0.05, (3, HEIGHT, WIDTH)).astype(np.float32)
    return values, values.sum(0) / used.sum(0), reference


# --------------------------------- the choice -----------------------------------------------------


def test_only_candidates_are_shown(wall):
    valid = np.random.default_rng(1).random((PAIRS + 1, HEIGHT, WIDTH)) < 0.6
    valid[0] = True
    values, mean, reference = random_frame(valid=valid)
    estimators = PairEstimators([color(v) for v in values], [mi.Bool(lanes_of(v)) for v in valid])
    shown = chosen(wall, color(mean), estimators, color(reference))
    pairs = valid.sum(0) - 1
    options = [(mean, np.ones_like(valid[0]))]
    for value, used in zip(values, valid, strict=True):
        step = (mean - value) / np.maximum(pairs, 1)
        options.append((mean + step, used & (pairs > 1)))
    for i, j in itertools.combinations(range(PAIRS + 1), 2):
        options.append(((values[i] + values[j]) / 2, valid.all(0)))
    # Convex combinations of estimates: nothing becomes negative.
    assert all((option[:, used] >= -1e-6).all() for option, used in options)
    distance = np.stack(
        [
            np.where(used, np.abs(option.transpose(1, 2, 0) - shown).max(-1), np.inf)
            for option, used in options
        ]
    )
    assert distance.min(0).max() < 1e-5
    taken = np.bincount(distance.argmin(0).ravel(), minlength=len(options))
    assert taken.min() > 100


def test_estimates_of_earlier_rounds_are_shown(wall):
    """Where the last round has nothing to choose from, those of the first are all there is."""
    values, first, reference = random_frame()
    last = np.ones_like(first)
    rounds = [
        Round(color(first), PairEstimators([color(v) for v in values], everywhere())),
        Round(color(last), PairEstimators([color(last)] * (PAIRS + 1), everywhere())),
    ]
    aim = select.Aim(color(reference), neighborhoods(wall)[0], SIGMA)
    shown = image(select.choose(grid_of(*SIZE), key(0, 1), rounds, aim)).transpose(2, 0, 1)
    steps = [(first - value) / PAIRS for value in values]
    distance = np.stack(
        [np.abs(option - shown).max(0) for option in (last, *(first + s for s in steps))]
    )
    assert distance.min(0).max() < 1e-5
    assert np.bincount(distance.argmin(0).ravel(), minlength=5).min() > 100


def test_no_candidate_is_below_zero(rgb):
    """The mean without the one estimate that has light is zero, not what rounding leaves."""
    values, _, _ = random_frame()
    values[1:] = 0
    pixels = PairEstimators([color(v) for v in np.roll(values, 1, axis=0)], everywhere())
    mean = sum(pixels.colors, mi.Color3f(0)) / (PAIRS + 1)
    lowest = [float(dr.min(dr.min(c))[0]) for c, _ in candidates([Round(mean, pixels)])]
    assert len(lowest) == PAIRS + 1 + 6
    assert min(lowest) == 0


def test_every_choice_is_the_best_when_it_is_made(wall):
    # For the pixels of the last set, whose neighbours have all chosen.
    values, mean, reference = random_frame(shape=4.0)
    estimators = PairEstimators([color(v) for v in values], everywhere())
    shown = chosen(wall, color(mean), estimators, color(reference), sample=5)
    turns = uniform2(key(5, 1).stream(Purpose.SELECTION, 0), 0, 0)
    pixel, inside = pixels_of_set(8, turns)
    last = np.array(pixel)[np.array(inside)]
    wide = np.pad(shown - reference.transpose(1, 2, 0), ((2, 2), (2, 2), (0, 0)))
    wanted = -sum(
        np.exp(-(dx**2 + dy**2) / 4) * wide[2 + dy : 2 + dy + HEIGHT, 2 + dx : 2 + dx + WIDTH]
        for dx, dy in itertools.product(range(-2, 3), repeat=2)
        if 0 < dx**2 + dy**2 < 8
    )

    def cost(option):
        error = option - reference.transpose(1, 2, 0)
        return lanes_of(((error - wanted) ** 2).sum(-1))[last]

    own, plain = cost(shown), mean.transpose(1, 2, 0)
    for value in values:
        step = (plain - value.transpose(1, 2, 0)) / PAIRS
        for option in (plain, plain + step):
            assert np.all(own <= cost(option) + 1e-3)
    assert np.mean(own < cost(plain) - 1e-3) > 0.5


def test_sets_cover_the_image_once(rgb):
    for first, factor in itertools.product((0.0, 0.5, 0.99), np.linspace(0.0, 0.99, 6)):
        visits = np.zeros(WIDTH * HEIGHT, int)
        for index in range(select.SPACING**2):
            pixel, inside = pixels_of_set(index, (mi.Float(first), mi.Float(factor)))
            visits[np.array(pixel)[np.array(inside)]] += 1
        assert np.all(visits == 1)
    # Pixels of one set do not see each other.
    assert max(max(abs(x), abs(y)) for x, y in OFFSETS) < select.SPACING


def to_neighbors(step):
    """Of every pixel's neighbours: where they are, and whether that is in the image."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for dx, dy in OFFSETS:
        there_x, there_y = x + step * dx, y + step * dy
        inside = (there_x >= 0) & (there_x < WIDTH) & (there_y >= 0) & (there_y < HEIGHT)
        yield (np.where(inside, there_y, 0), np.where(inside, there_x, 0)), inside


def test_similar_neighbors(edges):
    alike, further = (image_of(found, WIDTH, HEIGHT) for found in neighborhoods(edges))
    for i, (there, inside) in enumerate(to_neighbors(1)):
        other = dr.gather(type(edges), edges, mi.UInt32(lanes_of(order(WIDTH, HEIGHT)[there])))
        pair = (edges, other) if i >= len(OFFSETS) // 2 else (other, edges)
        expected = inside & image_of(similar(*pair), WIDTH, HEIGHT)
        np.testing.assert_array_equal((alike >> i) & 1, expected)
        np.testing.assert_array_equal((further >> i) & 1, expected & (alike[there] >> i))
    # To be alike is mutual.
    for i, (there, inside) in enumerate(to_neighbors(1)):
        back = (alike[there] >> (len(OFFSETS) - 1 - i)) & 1
        np.testing.assert_array_equal((alike >> i) & 1, inside & back)


@pytest.mark.parametrize("step", [1, 2])
def test_local_mean(edges, step):
    alike = neighborhoods(edges)[step - 1]
    bits = image_of(alike, WIDTH, HEIGHT)
    values = np.random.default_rng(0).random((HEIGHT, WIDTH)).astype(np.float32)
    means = image(local_mean(grid_of(*SIZE), color(values), alike, step))
    total, count = values.astype(float), np.ones((HEIGHT, WIDTH))
    for i, (there, inside) in enumerate(to_neighbors(step)):
        used = ((bits >> i) & 1).astype(bool)
        assert np.all(inside[used])
        total += np.where(used, values[there], 0)
        count += used
    np.testing.assert_allclose(means[..., 1], total / count, rtol=1e-5)
    assert count.min() < count.max() == len(OFFSETS) + 1


def test_nothing_leaks_across_edges(edges):
    # What the pixels of the sheet have does not change what is shown of the wall.
    sheet = image_of(edges.vertex.p.z, WIDTH, HEIGHT) > 1
    assert 0.2 < sheet.mean() < 0.8
    shown = {}
    for factor, changing in itertools.product((1.0, 50.0), (False, True)):
        values, mean, reference = random_frame()
        scale = np.where(sheet, factor, 1.0)
        estimators = PairEstimators([color(v * scale) for v in values], everywhere())
        past = color(reference * np.where(sheet, 3.0 * factor, 1.0))
        if changing:
            brighter = color(mean * scale)
            past *= color_history.brightness(grid_of(*SIZE), past, brighter, *neighborhoods(edges))
        shown[factor, changing] = chosen(edges, color(mean * scale), estimators, past)
    for changing in (False, True):
        a, b = shown[1.0, changing], shown[50.0, changing]
        np.testing.assert_array_equal(a[~sheet], b[~sheet])
        assert np.any(a[sheet] != b[sheet])


def test_without_history_the_plain_average_is_shown(wall):
    values, mean, _ = random_frame()
    estimators = PairEstimators([color(v) for v in values], everywhere())
    for reference in (mean, np.zeros_like(mean)):
        shown = chosen(wall, color(mean), estimators, color(reference))
        np.testing.assert_array_equal(shown, mean.astype(np.float32).transpose(1, 2, 0))


# --------------------------------- the history ----------------------------------------------------


def history_of(hits, values):
    """A colour history of 10 frames."""
    size = WIDTH * HEIGHT
    alike, _ = neighborhoods(hits)
    frames, excess = dr.full(mi.Float, 10, size), dr.zeros(mi.Color3f, size)
    return ColorHistory(color(values), frames, excess, alike)


def moved(dx, dy, jitter=(0.5, 0.5), valid=None):
    """The motion of surfaces that were (dx, dy) pixels further on, seen at a place in the pixel."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    column, row = np.floor(x + jitter[0] + dx), np.floor(y + jitter[1] + dy)
    inside = (column >= 0) & (column < WIDTH) & (row >= 0) & (row < HEIGHT)
    known = inside if valid is None else inside & valid
    there = (np.where(inside, index, 0).astype(int) for index in (row, column))
    pixel = order(WIDTH, HEIGHT)[tuple(there)]
    flow = mi.Vector2f(dr.full(mi.Float, dx, WIDTH * HEIGHT), dr.full(mi.Float, dy, WIDTH * HEIGHT))
    no = dr.zeros(mi.Bool, WIDTH * HEIGHT)
    return Motion(mi.UInt32(lanes_of(pixel)), mi.Bool(lanes_of(known)), flow, no, no)


def carried_image(hits, values, motion):
    return image(color_history.carried(grid_of(*SIZE), history_of(hits, values), motion).color)


def waves(period, x, y):
    return 1 + 0.5 * np.cos(2 * np.pi * x / period) * np.cos(2 * np.pi * y / period)


@pytest.mark.parametrize("jitter", [(0.01, 0.5), (0.99, 0.01), (0.5, 0.5)])
def test_history_is_interpolated(wall, jitter):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for dx, dy in ((0.0, 0.0), (0.3, -0.4), (2.5, 1.7), (1e-5, -1e-5)):
        found = carried_image(wall, waves(16, x, y), moved(dx, dy, jitter))[4:-4, 4:-4, 1]
        np.testing.assert_allclose(found, waves(16, x + dx, y + dy)[4:-4, 4:-4], atol=0.01)


def test_history_is_hardly_blurred(wall):
    """30 frames at a third of a pixel each keep 0.6 of a wave of 8 pixels; bilinear: 0.12."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    values = waves(8, x, y)
    for _ in range(30):
        values = carried_image(wall, values, moved(1 / 3, 0))[..., 1]
    inner = slice(20, -20)
    kept = values[inner, inner].std() / waves(8, x, y)[inner, inner].std()
    print(kept)
    assert kept > 0.6


def test_history_stays_within_what_is_there(edges):
    rng = np.random.default_rng(0)
    sheet = image_of(edges.vertex.p.z, WIDTH, HEIGHT) > 1
    values = np.where(sheet, 50, 1) * rng.exponential(size=(HEIGHT, WIDTH))
    motion = moved(0.4, 0.6)
    found = lanes_of(carried_image(edges, values, motion)[..., 1])
    there = np.array(motion.pixel)
    of_wall = np.array(motion.valid) & ~lanes_of(sheet)[there]
    assert found.min() >= 0
    assert found[of_wall].max() <= values[~sheet].max() + 1e-5
    nothing = carried_image(edges, values, moved(0.4, 0.6, valid=sheet))
    assert np.all(nothing[~sheet] == 0)


def test_smoothing_keeps_edges_and_takes_noise(edges):
    rng = np.random.default_rng(0)
    sheet = image_of(edges.vertex.p.z, WIDTH, HEIGHT) > 1
    left = np.arange(WIDTH) < WIDTH // 3
    truth = np.where(sheet, 50.0, np.where(left, 1.0, 0.05))
    noisy = truth * rng.gamma(100, 0.01, truth.shape)
    found = color_history.smoothed(grid_of(*SIZE), history_of(edges, noisy), *neighborhoods(edges))
    error = image(found)[..., 1] / truth - 1
    print(error.std(), np.abs(error).max())
    assert error.std() < 0.035
    assert np.abs(error).max() < 0.2


def test_excess_is_taken_out(wall):
    """A choice that adds 5 % to what it aims at is aimed 5 % lower after a while."""
    alike, _ = neighborhoods(wall)
    colors, mean = history_of(wall, np.ones((HEIGHT, WIDTH))), color(np.ones((3, HEIGHT, WIDTH)))
    for _ in range(60):
        shown = colors.color - colors.excess + 0.05
        colors = color_history.aimed(grid_of(*SIZE), colors, shown, mean, alike)
        dr.eval(colors)
    np.testing.assert_allclose(image(colors.excess), 0.05, atol=1e-3)


def test_excess_spreads_and_stays(wall):
    alike, _ = neighborhoods(wall)
    ones = np.ones((3, HEIGHT, WIDTH))
    shown = ones.copy()
    shown[:, HEIGHT // 2, WIDTH // 2] = 3
    before = history_of(wall, ones)
    found = image(
        color_history.aimed(grid_of(*SIZE), before, color(shown), color(ones), alike).excess
    )
    share = 1 / (float(before.frames[0]) * (len(OFFSETS) + 1))
    np.testing.assert_allclose(found.max(), 2 * share, rtol=1e-4)
    np.testing.assert_allclose(found.sum((0, 1)), 2 / float(before.frames[0]), rtol=1e-4)


# --------------------------------- bias -----------------------------------------------------------


@dataclass(frozen=True)
class Field:
    """Independent estimates, and the largest bias [relative to the mean] that is allowed."""

    bound: float
    lit: float = 1.0  # share of estimates that are not zero
    shape: float = 2.0  # of the gamma distribution of those
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ranked: bool = False  # each neighbour's estimate is from a stratum of its own
    paired: float = 1.0  # share of neighbours that are valid
    darkness: float = 1.0  # mean on one side of the edges
    speed: int = 0  # of the edges [pixels per frame]
    calm: bool = False  # the estimates of the left half are those of "smooth"


FIELDS = {
    "smooth": Field(0.001),
    "heavy tails": Field(0.007, lit=0.15, shape=1.0),
    "heavier tails": Field(0.018, lit=0.15, shape=0.3),
    "rare light beside a calm half": Field(0.02, lit=0.05, shape=1.0, calm=True),
    "heavy tails, ranked": Field(0.007, lit=0.15, shape=1.0, ranked=True),
    "heavy tails, blue": Field(0.007, lit=0.15, shape=1.0, tint=(0.05, 0.05, 1.0)),
    "heavy tails, few pairs": Field(0.012, lit=0.15, shape=1.0, paired=0.6),
    "shadow edge": Field(0.015, darkness=0.1),
    "moving shadow edge": Field(0.045, darkness=0.1, speed=1),
    "moving shadow edge, heavy tails": Field(0.3, lit=0.15, shape=1.0, darkness=0.1, speed=1),
}


def light(field, frame):
    """Expectation of every pixel: a dark half with two vertical edges."""
    start = field.speed * frame % WIDTH
    dark = (np.arange(WIDTH) - start) % WIDTH < WIDTH // 2
    return np.broadcast_to(np.where(dark, field.darkness, 1.0), (HEIGHT, WIDTH))


def regions(field, frame):
    """All pixels; the halves that differ; the 8 columns that each edge has just passed, or
    3 on each side of it."""
    column = np.broadcast_to(np.arange(WIDTH), (HEIGHT, WIDTH))
    found = [np.ones_like(column, bool)]
    if field.calm:
        found += [column < WIDTH // 2, column >= WIDTH // 2]
    if field.darkness < 1.0:
        reach = np.arange(-8, 0) if field.speed else np.arange(-3, 3)
        edges = (field.speed * frame, field.speed * frame + WIDTH // 2)
        found += [np.isin(column, (edge + reach) % WIDTH) for edge in edges]
    return found


def sequence(hits, field, warmup=WARMUP, frames=FRAMES):
    """Yield (frame, plain average, shown) of independent frames after the warm-up."""
    rng = np.random.default_rng(0)

    @dr.freeze
    def step(hits, before, colors, valid, sample, seed):
        mean = sum(colors[1:], colors[0]) / sum(dr.select(v, mi.Float(1), 0) for v in valid)
        dr.eval(mean)
        estimators = PairEstimators(colors, valid)
        scope = replace(NOWHERE, grid=grid_of(*SIZE), key=FrameKey(sample, seed))
        rounds, changing = [Round(mean, estimators)], field.speed > 0
        shown, history = select.select(scope, hits, rounds, before, SIGMA, changing)
        dr.eval(history, shown)
        return history, mean, shown

    history = dr.gather(ColorHistory, no_color_history(), dr.zeros(mi.UInt32, WIDTH * HEIGHT))
    seed = dr.opaque(mi.UInt32, 0)
    dr.make_opaque(history)
    for frame in range(warmup + frames):
        values, used = estimates(rng, field)
        bright = np.multiply.outer(field.tint, light(field, frame))
        colors = [color(v * bright) for v in values]
        valid = [mi.Bool(lanes_of(v)) for v in used]
        sample = dr.opaque(mi.UInt32, frame)
        history, mean, shown = step(hits, history, colors, valid, sample, seed)
        if frame >= warmup:
            yield frame, *(np.mean(image(x) / bright.transpose(1, 2, 0), 2) for x in (mean, shown))


def estimates(rng, field):
    """Estimates of mean 1 (4, HEIGHT, WIDTH), zero where they are not valid; which are valid."""
    uniform = rng.random((PAIRS + 1, HEIGHT, WIDTH))
    if field.ranked:
        uniform[1:] = (np.arange(PAIRS)[:, None, None] + uniform[1:]) / PAIRS
    bright = np.clip((uniform - (1 - field.lit)) / field.lit, 0, None)
    values = stats.gamma.ppf(bright, field.shape) / (field.shape * field.lit)
    if field.calm:
        values[..., : WIDTH // 2] = stats.gamma.ppf(uniform[..., : WIDTH // 2], 2) / 2
    valid = rng.random(values.shape) < field.paired
    valid[0] = True
    return values * valid, valid


def biases(hits, field):
    """Relative bias and its standard error in every region."""
    found = []
    for frame, mean, shown in sequence(hits, field):
        found.append([(shown - mean)[region].mean() for region in regions(field, frame)])
    batches = np.reshape(found, (-1, BATCH, len(found[0]))).mean(1)
    return batches.mean(0), batches.std(0, ddof=1) / np.sqrt(len(batches))


@pytest.mark.parametrize("name", FIELDS)
def test_bias_is_bounded(wall, name):
    bias, error = biases(wall, FIELDS[name])
    print(name, np.round(100 * bias, 2), "+-", np.round(100 * error, 2), "%")
    assert np.all(np.abs(bias) + ERRORS * error < FIELDS[name].bound)


CONTROLS = {
    "bound on errors": (
        "rare light beside a calm half",
        Mutation("dr.minimum(color, BRIGHTEST * reference)", "mi.Color3f(color)"),
    ),
    "brightness of the frame": (
        "moving shadow edge",
        Mutation("dr.select(before > 0, now / before, 0)", "mi.Float(1)"),
    ),
    "clamp to the frame": (
        "moving shadow edge",
        Mutation(
            "dr.clip(before.color, centre - deviation, centre + deviation)",
            "mi.Color3f(before.color)",
        ),
    ),
}


@pytest.mark.parametrize("name", CONTROLS)
def test_control_of_the_bias(wall, monkeypatch, name):
    field, mutation = CONTROLS[name]
    apply(monkeypatch, (mutation,))
    bias, error = biases(wall, FIELDS[field])
    print(name, np.round(100 * bias, 2), "+-", np.round(100 * error, 2), "%")
    assert np.any(np.abs(bias) - ERRORS * error > FIELDS[field].bound)


def off_by(hits, field):
    """Largest relative difference of a frame's means, among the first frames of a history."""
    frames = sequence(hits, FIELDS[field], 0, 20)
    return max(abs(shown.mean() / mean.mean() - 1) for _, mean, shown in frames)


@pytest.mark.parametrize("field", ["smooth", "heavy tails"])
def test_every_frame_is_as_bright_as_the_plain_one(wall, field):
    assert off_by(wall, field) < 1e-5


def test_control_of_the_brightness_of_a_frame(wall, monkeypatch):
    apply(monkeypatch, (Mutation("dr.select(dr.isfinite(f), b, 1)", "mi.Float(1)"),))
    assert off_by(wall, "heavy tails") > 0.01


def test_brightness_of_a_frame_is_bounded(rgb):
    """A bright estimate that is not shown makes no flash; black frames and infinite ones stay."""
    ones, values = np.ones((3, HEIGHT, WIDTH)), np.random.default_rng(0).random((3, HEIGHT, WIDTH))
    for factor, expected in ((1.05, 1.05), (0.97, 0.97), (3.0, 1.1), (0.2, 0.9), (np.inf, 1.0)):
        found = image(select.as_bright(color(values), color(values * factor)))
        np.testing.assert_allclose(found, expected * values.transpose(1, 2, 0), rtol=1e-5)
    np.testing.assert_array_equal(image(select.as_bright(color(0 * ones), color(0 * ones))), 0)
    tinted = image(select.as_bright(color(ones), color(ones * [[[1.02]], [[1.0]], [[0.95]]])))
    np.testing.assert_allclose(tinted.mean((0, 1)), [1.02, 1.0, 0.95], rtol=1e-4)


# --------------------------------- spectrum -------------------------------------------------------


def low_powers(hits):
    """Power in the low bands of plain averages and of what is shown, relative to white noise's."""
    frames = [frame for _, *frame in sequence(hits, FIELDS["smooth"])]
    plain, shown = (np.stack(images) - 1 for images in zip(*frames, strict=True))
    assert shown.std() < 1.1 * plain.std()
    return [band_power(power_spectrum(e), TABLE_BANDS) / plain.var() for e in (plain, shown)]


def test_error_is_blue(wall):
    plain, shown = low_powers(wall)
    print(plain, shown)
    np.testing.assert_allclose(plain, 1, atol=0.1)
    assert np.all(shown < 0.1)


def test_control_neighbors_unseen(wall, monkeypatch):
    apply(
        monkeypatch,
        (
            Mutation(
                "expected - neighbors_error(grid, error, around, pixel, aim.sigma)", "expected"
            ),
        ),
    )
    _, shown = low_powers(wall)
    print(shown)
    assert np.all(shown > 0.1)
