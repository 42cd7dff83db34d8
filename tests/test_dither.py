"""Dithered primary samples: uniform over seeds, blue over pixels, replayed exactly."""

import itertools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats

from mitsuba_restir.analysis.spectrum import band_power, power_spectrum
from mitsuba_restir.sampling import masks
from mitsuba_restir.sampling.dither import Dither, mask_texture
from mitsuba_restir.sampling.streams import (
    DIRECTION,
    LIGHT,
    LOBE,
    WAVELENGTH,
    PathName,
    uniform2,
)

DITHERED = [(LOBE, 0), (DIRECTION, 0), (DIRECTION, 1), (LIGHT, 0), (LIGHT, 1)]
ALPHA = 1e-4
WIDTH, HEIGHT = 96, 80


@pytest.fixture(scope="module")
def blue():
    return masks.void_and_cluster(64, 0)


def dither(ranks, vertices=1):
    return Dither(mask_texture(ranks), vertices)


def dithered(name, setting, width=WIDTH):
    """The stream of a path (pixel, sample, seed) in an image of that width."""
    pixel = mi.UInt32(name[0])
    return setting.stream(PathName(*name), pixel % width, pixel // width)


def samples(pixel, sample, seed, setting, vertex=1, width=WIDTH):
    """The five numbers of a vertex that can be dithered, (5, lanes)."""
    stream = dithered((pixel, sample, seed), setting, width)
    blocks = {
        block: uniform2(stream, mi.UInt32(vertex), block) for block in (LOBE, DIRECTION, LIGHT)
    }
    lanes = max(dr.width(pixel), dr.width(sample), dr.width(seed))
    return np.stack(
        [np.array(blocks[block][i] + dr.zeros(mi.Float, lanes)) for block, i in DITHERED]
    )


def chi_square(counts):
    """Probability of counts at least as uneven as these."""
    return stats.chisquare(counts.ravel()).pvalue


def many_seeds(count, start=0):
    return dr.arange(mi.UInt32, count) + start


@pytest.mark.parametrize("vertex", [1, 2])
def test_every_dimension_is_uniform_over_seeds(rgb, blue, vertex):
    # One pixel and one sample; only the offset and the jitter differ.
    u = samples(mi.UInt32(1234), mi.UInt32(3), many_seeds(40_000), dither(blue, 2), vertex)
    assert np.all((u >= 0.0) & (u < 1.0))
    for values in u:
        assert chi_square(np.bincount((values * 64).astype(int), minlength=64)) > ALPHA
        # Within the cells of the mask's 4096 ranks.
        inside = (values * 4096.0) % 1.0
        assert chi_square(np.bincount((inside * 16).astype(int), minlength=16)) > ALPHA


def test_dimensions_are_independent_over_seeds(rgb, blue):
    setting = dither(blue, 2)
    pixel, sample = mi.UInt32(77), mi.UInt32(9)
    u = np.concatenate(
        [samples(pixel, sample, many_seeds(40_000), setting, vertex) for vertex in (1, 2)]
    )
    cells = (u * 16).astype(int)
    for a, b in itertools.combinations(cells, 2):
        assert chi_square(np.bincount(a * 16 + b, minlength=256)) > ALPHA


def test_neighbours_depend_on_each_other(rgb, blue):
    # What dithering is for, and the control of the test of independence.
    setting = dither(blue)
    u = [samples(mi.UInt32(p), mi.UInt32(0), many_seeds(20_000), setting) for p in (500, 501)]
    for a, b in zip(*u, strict=True):
        cells = (a * 16).astype(int) * 16 + (b * 16).astype(int)
        assert chi_square(np.bincount(cells, minlength=256)) < 1e-12
        assert np.corrcoef(a, b)[0, 1] < -0.1


def test_a_fixed_offset_is_not_uniform(rgb, blue):
    level = np.array(mask_texture(blue).level(mi.UInt32(5), mi.UInt32(6), mi.UInt32(0)))
    assert np.all(level >> (32 - 12) == blue[6, 5])


@pytest.mark.parametrize("sample", [0, 1, 100_000_007])
def test_spectrum_over_pixels_is_blue(rgb, blue, sample):
    pixel = dr.arange(mi.UInt32, 64 * 64)
    for ranks, below in ((blue, 0.2), (masks.white(64, 0), None)):
        setting = dither(ranks)
        powers = []
        for seed in range(6):
            u = samples(pixel, mi.UInt32(sample), mi.UInt32(seed), setting, width=64)
            u = u.reshape(5, 64, 64)
            powers.append([power_spectrum(v, window="none") * 12.0 for v in u])
        # Rotating the values (the fractional part) splits some neighbours and costs blueness.
        low, high = band_power(np.mean(powers, axis=0), [(0.0, 0.125), (0.35, 0.5)]).T
        if below is None:
            np.testing.assert_allclose([low, high], 1.0, atol=0.3)
        else:
            assert np.all(low < below)
            assert np.all(high > 1.1)


def test_mask_repeats_beyond_its_side(rgb, blue):
    u = samples(
        dr.arange(mi.UInt32, WIDTH * HEIGHT), mi.UInt32(5), mi.UInt32(6), dither(blue)
    ).reshape(5, HEIGHT, WIDTH)
    # Equal but for the jitter, which is less than a rank.
    difference = np.abs(u[:, :, 64:] - u[:, :, : WIDTH - 64])
    assert np.minimum(difference, 1.0 - difference).max() < 1.0 / 4096.0
    difference = np.abs(u[:, 64:] - u[:, : HEIGHT - 64])
    assert np.minimum(difference, 1.0 - difference).max() < 1.0 / 4096.0
    assert difference.max() > 0.0


def test_replay_is_exact_from_the_record(rgb, blue):
    rng = np.random.default_rng(0)
    name = [mi.UInt32(rng.integers(limit, size=500)) for limit in (WIDTH * HEIGHT, 2**32, 2**32)]
    setting = dither(blue, 2)
    for vertex in (1, 2):
        together = samples(*name, setting, vertex)
        for lane in (0, 17, 499):
            alone = samples(*[mi.UInt32(int(word[lane])) for word in name], setting, vertex)
            np.testing.assert_array_equal(together[:, lane], alone[:, 0])
        # Another setting of equal content, in another order of pixels.
        backwards = [dr.gather(mi.UInt32, word, 499 - dr.arange(mi.UInt32, 500)) for word in name]
        again = samples(*backwards, dither(blue, 2), vertex)
        np.testing.assert_array_equal(together, again[:, ::-1])


def test_only_the_first_dimensions_are_dithered(rgb, blue):
    name = (dr.arange(mi.UInt32, 1000), mi.UInt32(3), mi.UInt32(4))
    plain = PathName(*name).stream()
    for vertices in (1, 2):
        stream = dithered(name, dither(blue, vertices))
        for vertex, block in itertools.product(range(5), (LOBE, DIRECTION, LIGHT, WAVELENGTH)):
            pair = zip(uniform2(stream, vertex, block), uniform2(plain, vertex, block), strict=True)
            for i, (a, b) in enumerate(pair):
                changed = bool(dr.any(a != b))
                assert changed == (1 <= vertex <= vertices and (block, i) in DITHERED)


def test_vertex_may_differ_from_lane_to_lane(rgb, blue):
    setting = dither(blue, 2)
    pixel = mi.UInt32(4, 4, 4, 4)
    stream = dithered((pixel, mi.UInt32(1), mi.UInt32(2)), setting)
    mixed = np.array(uniform2(stream, mi.UInt32(0, 1, 2, 3), DIRECTION)[0])
    for vertex in range(4):
        assert mixed[vertex] == np.array(uniform2(stream, vertex, DIRECTION)[0])[0]


def test_samples_of_a_pixel_are_even_in_each_dimension(rgb, blue):
    # Kronecker sequences: N points leave no gap much above 1/N, which hashed numbers do.
    count = 32
    name = (mi.UInt32(9), dr.arange(mi.UInt32, count), mi.UInt32(0))
    for vertex in (1, 2):
        u = samples(*name, dither(blue, 2), vertex)
        for values in np.sort(u, axis=1):
            gaps = np.diff([*values, values[0] + 1.0])
            assert gaps.max() < 3.0 / count


SHAPES = {
    "sum": lambda a, b: a + b < 1.0,
    "difference": lambda a, b: a < b,
    "disc": lambda a, b: (a - 0.5) ** 2 + (b - 0.5) ** 2 < 0.1,
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("vertex", [1, 2])
def test_samples_of_a_pixel_are_even_in_pairs(rgb, blue, shape, vertex):
    # Variance over seeds of the mean of 20 samples, against 20 independent ones.
    count, seeds = 20, 1000
    lane = dr.arange(mi.UInt32, count * seeds)
    u = samples(mi.UInt32(9) + 0 * lane, lane % count, lane // count, dither(blue, 2), vertex)
    for a, b in ((u[1], u[2]), (u[3], u[4])):
        inside = SHAPES[shape](a, b).reshape(seeds, count)
        assert inside.mean(axis=1).var() < 0.4 * inside.var() / count


@dr.syntax
def walk(setting, pixel, sample, seed):
    stream = dithered((pixel, sample, seed), setting)
    vertex, total = mi.UInt32(1), mi.Float(0)
    while vertex < 4:
        a, b = uniform2(stream, vertex, DIRECTION)
        total += a * b
        vertex += 1
    return total


def test_runs_inside_symbolic_loops_and_frozen_functions(rgb, blue):
    pixel = dr.arange(mi.UInt32, 256)
    setting = dither(blue)
    frozen = dr.freeze(walk)
    for sample in range(3):
        name = dr.opaque(mi.UInt32, sample), dr.opaque(mi.UInt32, 7)
        expected = np.zeros(256, np.float32)
        for vertex in (1, 2, 3):
            a, b = uniform2(dithered((pixel, *name), setting), vertex, DIRECTION)
            expected += np.array(a * b)
        np.testing.assert_allclose(np.array(frozen(setting, pixel, *name)), expected, rtol=1e-6)


@pytest.mark.parametrize("shape", [(48, 48), (32, 64), (16,)])
def test_masks_of_other_shapes_are_refused(rgb, shape):
    with pytest.raises(ValueError, match="power of two"):
        mask_texture(np.zeros(shape, np.uint32))


@pytest.mark.parametrize("vertices", [0, 3])
def test_number_of_vertices_is_checked(rgb, blue, vertices):
    with pytest.raises(ValueError, match=f"1 to 2, not {vertices}"):
        dither(blue, vertices)
