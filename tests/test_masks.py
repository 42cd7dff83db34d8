"""Masks: the energy is the published one and falls, ranks are uniform, the spectrum is blue."""

import os
import subprocess
import sys

import numpy as np
import pytest

from mitsuba_restir.analysis.spectrum import band_power, power_spectrum
from mitsuba_restir.sampling import georgiev, masks
from mitsuba_restir.sampling.georgiev import Stage, anneal, energy
from mitsuba_restir.sampling.void_cluster import void_and_cluster


def brute_force(values, radius=None):
    """The energy as the paper writes it: a sum over ordered pairs, distances wrap around."""
    n, d = values.shape[0], values.shape[2]
    total = 0.0
    for y in range(n):
        for x in range(n):
            for v in range(n):
                for u in range(n):
                    dy, dx = abs(y - v), abs(x - u)
                    squared = min(dy, n - dy) ** 2 + min(dx, n - dx) ** 2
                    if squared == 0 or (radius is not None and squared > radius**2):
                        continue
                    distance = np.linalg.norm(values[y, x] - values[v, u]) ** (d / 2)
                    total += np.exp(-squared / 2.1**2 - distance / 1.0**2)
    return total


@pytest.mark.parametrize("d", [1, 2, 3])
def test_energy_is_the_sum_over_pairs(d):
    values = np.random.default_rng(d).random((15, 15, d))
    result = energy(values)
    assert result == pytest.approx(brute_force(values, georgiev.RADIUS), rel=1e-12)
    # What the radius leaves out is less than a swap changes.
    assert result == pytest.approx(brute_force(values), rel=1e-3)
    if d == 1:
        assert energy(values[..., 0]) == result


def white_values(size, seed=0):
    return masks.mask_values(masks.white(size, seed))


@pytest.fixture(scope="module")
def annealed():
    values = white_values(64)
    source, stages = anneal(values, 1)
    return values, values.ravel()[source], stages


def test_energy_falls_from_temperature_to_temperature(annealed):
    values, result, stages = annealed
    energies = [energy(values), *(stage.energy for stage in stages)]
    greedy = [0.0] * georgiev.GREEDY_SWEEPS
    assert [stage.temperature for stage in stages] == [*georgiev.TEMPERATURES, *greedy]
    assert np.all(np.diff(energies) < 0.0)
    assert energy(result) == pytest.approx(stages[-1].energy, rel=1e-12)
    # As far below white noise as void-and-cluster, within a tenth of the way.
    lowest = energy(masks.mask_values(void_and_cluster(64, 0)))
    assert energies[-1] < energies[0] - 0.9 * (energies[0] - lowest)


def test_greedy_stage_is_monotonic_in_every_batch_of_swaps():
    values = white_values(21)
    swapper = georgiev._Swapper(values.reshape(-1, 1), 21, np.random.default_rng(0))
    before = energy(values)
    for _ in range(60):
        made = swapper._try_swaps(swapper._distant_pixels(3), 0.0)
        after = energy(values.ravel()[swapper.source].reshape(21, 21))
        assert (after < before) if made else (after == before)
        before = after


def test_swaps_change_the_energy_by_what_was_computed():
    values = white_values(28)
    swapper = georgiev._Swapper(values.reshape(-1, 1), 28, np.random.default_rng(0))
    before = energy(values)
    for _ in range(20):
        here, change = swapper._changes(swapper._distant_pixels(2))
        first, second = here.reshape(2, -1)
        for a, b, computed in zip(first, second, change, strict=True):
            swapped = values.ravel().copy()
            swapped[[a, b]] = swapped[[b, a]]
            assert energy(swapped.reshape(28, 28)) - before == pytest.approx(computed, rel=1e-3)


def test_hot_annealing_keeps_the_values_mixed_and_reaches_every_pixel():
    values = white_values(28)
    source, (stage,) = anneal(values, 0, [1e9], 200, 0)
    assert stage == Stage(1e9, energy(values.ravel()[source]), 1.0)
    assert sorted(source.ravel()) == list(range(28 * 28))
    # Every residue class of rows and columns is left: displacements take all values.
    rows = (source // 28 - np.arange(28)[:, None]) % 28
    columns = (source % 28 - np.arange(28)) % 28
    for displacement in (rows, columns):
        counts = np.bincount(displacement.ravel(), minlength=28)
        assert counts.min() > 0
        assert np.sum((counts - 28) ** 2 / 28) < 63.0  # chi-square, 27 degrees of freedom, 1e-4


def test_annealing_of_vectors_lowers_their_energy():
    values = np.random.default_rng(0).random((32, 32, 2))
    source, stages = anneal(values, 0, [0.1, 0.02], 4, 4)
    assert np.all(np.diff([energy(values), *(s.energy for s in stages)]) < 0.0)
    assert energy(values.reshape(-1, 2)[source]) == pytest.approx(stages[-1].energy)


def test_too_small_masks_cannot_be_annealed():
    with pytest.raises(ValueError, match=r"at least 14 .* not 13"):
        anneal(np.zeros((13, 13)), 0)


def bands(ranks):
    """Power relative to white noise's, below 1/8, around 0.2 and above 0.35 cycles/pixel."""
    values = masks.mask_values(ranks)
    power = power_spectrum(values, window="none") / values.var()
    return band_power(power, [(0.0, 0.125), (0.15, 0.25), (0.35, 0.5)])


def test_spectra(annealed):
    _, values, _ = annealed
    np.testing.assert_allclose(bands(masks.white(128, 0)), 1.0, atol=0.15)
    low, middle, high = bands(np.argsort(np.argsort(values.ravel())).reshape(64, 64))
    assert low < 0.05
    assert low < middle < 0.4
    assert high > 1.2
    low, middle, high = bands(void_and_cluster(128, 0))
    assert low < 0.002
    assert low < middle < 0.05
    assert high > 1.4


def test_void_and_cluster_is_even_at_every_threshold():
    ranks = void_and_cluster(64, 3)
    for share in (0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98):
        points = ranks < share * ranks.size
        # White noise would have a power of share * (1 - share) at every frequency.
        power = power_spectrum(points, window="none") / (share * (1.0 - share))
        # The fewer points (or holes), the lower the frequencies of which they can keep clear.
        limit = 0.4 * np.sqrt(min(share, 1.0 - share))
        assert band_power(power, [(0.0, limit)])[0] < 0.12


@pytest.mark.parametrize("kind", ["void_and_cluster", "white"])
@pytest.mark.parametrize("size", [14, 33, 64])
def test_ranks_are_a_permutation_and_reproducible(kind, size):
    ranks = masks.KINDS[kind](size, 5)
    assert ranks.dtype == np.uint32
    np.testing.assert_array_equal(np.sort(ranks.ravel()), np.arange(size * size))
    np.testing.assert_array_equal(ranks, masks.KINDS[kind](size, 5))
    assert np.any(ranks != masks.KINDS[kind](size, 6))


def test_annealed_ranks_are_a_permutation_and_reproducible(monkeypatch):
    monkeypatch.setattr(georgiev.anneal, "__defaults__", ((0.1,), 1, 1))
    ranks = masks.annealing(16, 5)
    np.testing.assert_array_equal(np.sort(ranks.ravel()), np.arange(256))
    np.testing.assert_array_equal(ranks, masks.annealing(16, 5))
    assert np.any(ranks != masks.annealing(16, 6))


def test_values_are_centred_in_their_cells():
    np.testing.assert_array_equal(
        masks.mask_values([[2, 0], [1, 3]]), [[0.625, 0.125], [0.375, 0.875]]
    )


# ------------------------------------------ cache -------------------------------------------------


@pytest.fixture
def counted(monkeypatch):
    """Count how often a mask is made."""
    made = []

    def generator(size, seed):
        made.append((size, seed))
        return masks.white(size, seed)

    monkeypatch.setitem(masks.KINDS, "annealing", generator)
    return made


def test_masks_are_made_once(tmp_path, counted):
    first = masks.load_mask("annealing", 16, 1, tmp_path / "new")
    np.testing.assert_array_equal(first, masks.load_mask("annealing", 16, 1, tmp_path / "new"))
    assert counted == [(16, 1)]
    masks.load_mask("annealing", 16, 2, tmp_path / "new")
    masks.load_mask("annealing", 17, 1, tmp_path / "new")
    assert counted == [(16, 1), (16, 2), (17, 1)]


def truncate(data):
    return data[:-7]


def repeat_a_rank(data):
    return data[:-4] + data[-8:-4]


def flip_a_high_bit(data):
    return data[:-1] + bytes([data[-1] ^ 0x80])


@pytest.mark.parametrize(
    "damage", [truncate, repeat_a_rank, flip_a_high_bit, lambda _: b"", lambda _: b"no mask"]
)
def test_a_damaged_file_is_made_anew(tmp_path, counted, damage):
    first = masks.load_mask("annealing", 16, 1, tmp_path)
    (path,) = tmp_path.iterdir()
    path.write_bytes(damage(path.read_bytes()))
    for _ in range(2):
        np.testing.assert_array_equal(first, masks.load_mask("annealing", 16, 1, tmp_path))
    assert len(counted) == 2
    assert list(tmp_path.iterdir()) == [path]


def test_another_mask_s_file_is_made_anew(tmp_path, counted):
    masks.load_mask("annealing", 16, 1, tmp_path)
    (path,) = tmp_path.iterdir()
    np.save(path, masks.white(17, 1))
    assert masks.load_mask("annealing", 16, 1, tmp_path).shape == (16, 16)


def test_an_unwritable_cache_costs_a_warning(tmp_path, counted):
    (tmp_path / "file").touch()
    with pytest.warns(UserWarning, match="not kept"):
        ranks = masks.load_mask("annealing", 16, 1, tmp_path / "file" / "folder")
    assert ranks.shape == (16, 16)


@pytest.mark.skipif(sys.platform != "linux", reason="the variable is Linux's")
def test_the_cache_is_the_user_s_own(tmp_path):
    program = "from mitsuba_restir.sampling import masks; print(masks.cache_folder())"
    result = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "MITSUBA_RESTIR_CACHE": "", "XDG_CACHE_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout.strip() == str(tmp_path / "mitsuba-restir" / "masks")


def test_the_cache_is_where_the_variable_says(tmp_path, monkeypatch):
    monkeypatch.setenv("MITSUBA_RESTIR_CACHE", str(tmp_path))
    masks.load_mask("annealing", 16, 1)
    assert [path.parent for path in tmp_path.rglob("*.npy")] == [tmp_path / "masks"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(("pink", 64), "annealing, white, not .pink."), (("white", 8), "14 to 4096")],
)
def test_bad_requests_say_what_is_allowed(arguments, message):
    with pytest.raises(ValueError, match=message):
        masks.load_mask(*arguments)
