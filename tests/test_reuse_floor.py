"""The floor of large-scale errors: the linear model of reuse, and the quantity `excess`.

The model is compared with noise that is really merged, frame by frame, with the package's own
pairings; the quantity with fields of known spectrum.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy import fft, ndimage

from mitsuba_restir.analysis import spectrum
from mitsuba_restir.analysis.reuse import (
    Reach,
    Reuse,
    mirrored_frequencies,
    power_of_reuse,
    reach,
    seen,
)
from mitsuba_restir.passes.temporal import YOUNG
from mitsuba_restir.sampling.pairing import pair_offsets
from mitsuba_restir.studies import load_study
from mitsuba_restir.studies.measure import excess
from mitsuba_restir.studies.measure.quantities import QUANTITIES
from mitsuba_restir.studies.measure.results import Measured, Refused, Row, Sharing
from mitsuba_restir.studies.runs.results import ReferenceImage, Run

SIDE = 128
SETTLED = 400


def merged_noise(reuse: Reuse, radius: float, rng: np.random.Generator) -> np.ndarray:
    """A frame that reuse leaves of white noise of variance 1, toroidal."""
    offsets = pair_offsets(radius, SIDE)
    rows, columns = np.mgrid[:SIDE, :SIDE]
    k = reuse.neighbors

    def spread(image: np.ndarray) -> np.ndarray:
        total = (2 * k + 1) / (k + 1) ** 2 * image
        for _ in range(k):
            shift = rng.integers(SIDE, size=2)
            dx, dy = np.moveaxis(np.roll(offsets, shift, axis=(0, 1)), -1, 0)
            total = total + k / (k + 1) ** 2 * image[(rows + dy) % SIDE, (columns + dx) % SIDE]
        return total

    image, confidence = rng.standard_normal((SIDE, SIDE)), 1.0
    for _ in range(1, reuse.frames):
        image = spread(image)
        confidence = min(confidence * (1 + k), reuse.cap)
        fresh = rng.standard_normal((SIDE, SIDE))
        image = (fresh + confidence * image) / (1 + confidence)
        confidence += 1.0
    return spread(image)


@pytest.mark.parametrize(
    ("frames", "cap", "neighbors", "radius"),
    [(1, 20.0, 3, 8.0), (30, 5.0, 3, 8.0), (40, 20.0, 1, 8.0), (5, 50.0, 6, 8.0)],
)
def test_the_model_is_what_merging_does(frames, cap, neighbors, radius):
    """Forty independent images, of each of which the wide Gaussian leaves 36 independent values."""
    reuse = Reuse(frames, cap, neighbors, (radius,))
    frequencies = spectrum.frequencies((SIDE, SIDE))
    power = power_of_reuse(reuse, frequencies)
    rng = np.random.default_rng(1)
    images = np.stack([merged_noise(reuse, radius, rng) for _ in range(40)])
    for sigma, within in ((0.0, 0.05), (1.5, 0.08), (6.0, 0.15)):
        view = ndimage.gaussian_filter(images, (0, sigma, sigma), mode="wrap")
        found, expected = float(np.mean(view**2)), seen(power, frequencies, sigma)
        print(f"{reuse}, {sigma} px: {found:.4g}, by the model {expected:.4g}")
        assert found == pytest.approx(expected, rel=within)


@pytest.mark.parametrize("cap", [5.0, 20.0, 100.0])
def test_a_settled_history_has_twice_the_cap_and_one_frames(cap):
    found = reach(Reuse(10 * SETTLED, cap, 3, (6.0,)), (32, 48), 3.0)
    assert found.frames == pytest.approx(2 * cap + 1, rel=1e-6)


def test_a_young_history_has_fewer_frames_than_it_is_long():
    """Neighbours' confidences add up: the first frame seems to be many, and counts as such."""
    summed = reach(Reuse(50, 100.0, 3, (6.0,)), (32, 48), 3.0)
    assert summed.frames < 5.0
    # With a confidence of their number, all frames count alike.
    alike = reach(Reuse(50, 100.0, 3, (6.0,), young=1.0), (32, 48), 3.0)
    assert alike.frames == pytest.approx(50.0, rel=1e-6)


def test_candidates_alone_are_their_own_floor():
    found = reach(Reuse(), (40, 60), 3.0)
    assert found.frames == 1.0
    assert found.sigma == pytest.approx(3.0, abs=0.01)


def test_reach_is_that_of_a_random_walk():
    """In a large image, far above the size of a pixel: sum of w² / (sigma² + D)."""
    cap, k, radius, sigma = 10.0, 3, 5.0, 6.0
    found = reach(Reuse(SETTLED, cap, k, (radius,)), (400, 400), sigma)
    age = np.arange(SETTLED)
    weight = (cap / (1 + cap)) ** age / (1 + cap)
    walk = (age + 1) * (k / (k + 1)) ** 2 * radius**2 / 4
    inverse = np.sum(weight**2 / (sigma**2 + walk)) * (2 * cap + 1)
    assert found.sigma**2 == pytest.approx(1 / inverse, rel=0.05)


# ------------------------------ the quantity ----------------------------------------------------

SHAPE = (72, 96)
REUSE = Reuse(60, 10.0, 3, (5.0,))
TREES = 4


def field_of(power: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A field of this power, mirrored at its border."""
    modes = rng.standard_normal(power.shape) * np.sqrt(power)
    return fft.idctn(modes, norm="ortho")


def data_of(factor: float, runs: int = 40, seed: int = 3) -> Measured:
    """Candidates of 4 trees, and frames of 1 tree with `factor` times the power of the model."""
    rng = np.random.default_rng(seed)
    power = factor * power_of_reuse(REUSE, mirrored_frequencies(SHAPE))
    fields = {
        "candidates": [rng.standard_normal(SHAPE) / np.sqrt(TREES) for _ in range(runs)],
        "frames": [field_of(power, rng) for _ in range(runs)],
    }

    def run(errors: np.ndarray) -> Run:
        image = ((1.0 + 0.1 * errors)[..., None] * np.ones(3)).astype(np.float32)
        return Run(image, image, np.ones(1), partial(np.asarray, image[None]))

    sharing = {
        "candidates": Sharing(Reuse(), TREES, "candidates"),
        "frames": Sharing(REUSE, 1, "candidates"),
    }
    truth = np.ones((*SHAPE, 3))
    # A reference's error is the same in all runs, and no part of a variance between them.
    noisy = truth + 0.05 * rng.standard_normal(SHAPE)[..., None]
    return Measured(
        "96x72",
        {name: [run(errors) for errors in own] for name, own in fields.items()},
        "candidates",
        dict.fromkeys(fields, "candidates"),
        ReferenceImage(noisy, np.full_like(truth, 0.05**2)),
        0.01,
        0.0,
        settled=True,
        sharing=sharing,
    )


def rows_of(data: Measured) -> dict[tuple[str, str], Row]:
    found = QUANTITIES["excess"].rows(data)
    return {(row.variant, row.quantity): row for row in found if isinstance(row, Row)}


@pytest.mark.parametrize("factor", [1.0, 2.5])
def test_excess_of_a_field_of_known_spectrum(factor):
    rows = rows_of(data_of(factor))
    for sigma in excess.SIGMAS:
        for label in ("", ", trimmed"):
            own = rows["frames", f"excess, {sigma:g} px{label}"]
            print(f"{sigma:g} px{label}: {own.value}")
            assert own.value.low < factor < own.value.high
            assert own.value.value == pytest.approx(factor, rel=0.25)
            alone = rows["candidates", f"excess, {sigma:g} px{label}"].value
            assert alone.value == pytest.approx(1.0, abs=1e-3)
    assert rows["frames", "effective frames"].value.value == pytest.approx(21.0, rel=0.01)


@pytest.mark.parametrize("forgotten", ["frames", "sigma"])
def test_control_without_reach_or_history(monkeypatch, forgotten):
    """A floor of one frame, or through the same Gaussian as the frame, is none."""

    def without(reuse: Reuse, shape: tuple[int, int], sigma: float) -> Reach:
        found = reach(reuse, shape, sigma)
        return replace(found, **{forgotten: {"frames": 1.0, "sigma": sigma}[forgotten]})

    monkeypatch.setattr(excess, "reach", without)
    rows = rows_of(data_of(1.0))
    value = rows["frames", "excess, 3 px"].value
    print(value)
    assert not value.low < 1.0 < value.high


def test_without_its_candidates_there_is_no_excess():
    data = data_of(1.0, 4)
    sharing = {**data.sharing, "frames": replace(data.sharing["frames"], candidates="")}
    found = list(QUANTITIES["excess"].rows(replace(data, sharing=sharing)))
    (refused,) = (row for row in found if isinstance(row, Refused))
    assert "no variant shows its candidates alone" in refused.reason
    own = {row.quantity for row in found if isinstance(row, Row) and row.variant == "frames"}
    assert own == {number.name for number in excess.NUMBERS if "variance" in number.name}


def test_how_the_variants_of_a_study_share():
    study = load_study("excess_small", ["variants.guided={type='restir_pt', guiding=true}"])
    sharing = excess.sharing_of(study)
    assert sharing["candidates"] == Sharing(Reuse(), 41, "candidates")
    # Frames 250, 270 and 290 of a history are measured.
    expected = Reuse(270, 100.0, 3, (3.0,), 16, YOUNG)
    assert sharing["cap_100_radius_3"] == Sharing(expected, 1, "candidates")
    assert sharing["guided"].candidates == ""
