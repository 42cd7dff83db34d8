"""The source document's rule: what it computes, that it has no hold on the image, and its bias."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from support import references
from support.bias import BiasReport
from support.modes import Mode
from support.pixels import image_of, lanes_of
from support.runs import bias_report, independent_runs, integrator
from support.scopes import mutation_plan, scope_of

from mitsuba_restir.analysis.images import luminance
from mitsuba_restir.mutations import energy as rule_module
from mitsuba_restir.mutations.chain import metropolis_hastings
from mitsuba_restir.mutations.energy import (
    SPACING,
    TEMPERATURE,
    Surroundings,
    energy_change,
    energy_rule,
    mutate_by_energy,
    mutate_by_updated_energy,
    normalised,
)
from mitsuba_restir.mutations.kind import Proposal
from mitsuba_restir.neighbors.around import spaced_pixels
from mitsuba_restir.paths.grid import grid_of
from mitsuba_restir.paths.spectrum import target
from mitsuba_restir.sampling.georgiev import energy, image_energy
from mitsuba_restir.studies import load_study, run_study
from mitsuba_restir.studies.config.adapt import on_scene, quick, without
from mitsuba_restir.studies.measure.mutation_spectra import numbers
from mitsuba_restir.studies.runs.results import ReferenceImage

pytestmark = pytest.mark.usefixtures("one_thread")

RULES = ("energy", "energy_updated")
STEP = 0.2


# ------------------------------ energy ----------------------------------------------------------


def brute_force(values: np.ndarray) -> np.ndarray:
    """Energies by the formula, pixel by pixel."""
    height, width = values.shape
    result = np.zeros(values.shape)
    for y, x in np.ndindex(height, width):
        for v, u in np.ndindex(height, width):
            distance2 = (y - v) ** 2 + (x - u) ** 2
            if 0 < distance2 <= 36:
                likeness = np.sqrt(abs(values[y, x] - values[v, u]))
                result[y, x] += np.exp(-distance2 / 2.1**2 - likeness)
    return result


@pytest.mark.parametrize("shape", [(1, 1), (3, 17), (15, 12)])
def test_energy_of_an_image(shape):
    values = np.random.default_rng(1).random(shape)
    np.testing.assert_allclose(image_energy(values), brute_force(values), rtol=1e-12)


def test_energy_of_an_image_is_the_mask_s_without_wrapping():
    values = np.random.default_rng(2).random((20, 20))
    surrounded = np.pad(values, 6, mode="wrap")
    assert image_energy(surrounded)[6:-6, 6:-6].sum() == pytest.approx(energy(values), rel=1e-12)


def around(values: np.ndarray, mean: float = 1.0) -> Surroundings:
    height, width = values.shape
    levels = mi.Float(lanes_of(values).astype(np.float32))
    result = Surroundings(grid_of(width, height), levels, mi.Float(mean))
    dr.make_opaque(result)
    return result


def test_change_of_a_pixel_s_energy(rgb):
    """At every pixel of an image, corners included, against the brute-force sum."""
    rng = np.random.default_rng(3)
    values = rng.random((7, 8)).astype(np.float32)
    new = rng.random(values.shape).astype(np.float32)
    pixel = dr.arange(mi.UInt32, values.size)
    old, wanted = (mi.Float(lanes_of(v)) for v in (values, new))
    found = energy_change(around(values), pixel, old, wanted)
    expected = np.zeros(values.shape)
    for y, x in np.ndindex(*values.shape):
        changed = values.copy()
        changed[y, x] = new[y, x]
        expected[y, x] = brute_force(changed)[y, x] - brute_force(values)[y, x]
    np.testing.assert_allclose(image_of(found, 8, 7), expected, atol=2e-5)


def test_values_are_between_0_and_1(rgb):
    x = mi.Float([0.0, 1e-30, 1.0, 3.0, 1e30])
    np.testing.assert_allclose(normalised(x, 1.0), [0, 1e-30, 0.5, 0.75, 1], rtol=1e-6)
    assert np.array(normalised(mi.Float(0), mi.Float(0))) == 0  # an image without light


# ------------------------------ rule ------------------------------------------------------------


@pytest.mark.parametrize("blend", [0.0, 0.25, 1.0])
def test_acceptance_is_the_document_s(rgb, blend):
    """On a row of pixels whose weight is 1/2, in an image of mean 1."""
    rng = np.random.default_rng(4)
    current, proposed, transition = rng.lognormal(size=(3, 50)).astype(np.float32)
    old, new = (c / 2 / (1 + c / 2) for c in (current, proposed))
    change = np.empty(50)
    for i in range(50):
        moved = old.copy()
        moved[i] = new[i]
        change[i] = (brute_force(moved[None]) - brute_force(old[None]))[0, i]
    annealed = np.where(change < 0, 1, np.exp(-np.maximum(change, 0) / TEMPERATURE))
    expected = (annealed * blend + proposed / current * (1 - blend)) * transition

    pixel = dr.arange(mi.UInt32, 50)
    acceptance = energy_rule(around(old[None]), pixel, mi.Float(0.5), blend)
    a, b = (SimpleNamespace(color=mi.Color3f(mi.Float(c))) for c in (current, proposed))
    proposal = Proposal(b, mi.Float(transition), shadow=None, tested=mi.Bool(False))
    found = acceptance(a, proposal)
    assert 0.2 < np.mean(change < 0) < 0.8
    # Energies in single precision are good to 1e-6, a thousandth of the temperature.
    np.testing.assert_allclose(np.array(found), expected, rtol=1e-2, atol=1e-6)
    if blend == 0:
        plain = metropolis_hastings(a, proposal)
        np.testing.assert_array_equal(np.array(found), np.array(plain))


@pytest.mark.parametrize("rule", RULES)
def test_without_its_share_the_rule_is_metropolis_hastings(rgb, rule):
    """Bit by bit the same frames as those that the tests of mutations find unbiased."""
    scene = references.CASES["room"].load()
    images = []
    for extra in ({}, {"mutation_acceptance": rule, "blue_noise_weight": 0.0}):
        renderer = integrator(5, reusing(3, **extra))
        images.append([np.array(renderer.render(scene, seed=s, spp=1)) for s in range(3)])
    np.testing.assert_array_equal(images[1], images[0])


def test_sets_are_a_partition_of_distant_pixels(rgb):
    for size in ((1, 1), (7, 5), (8, 12)):
        found = []
        for number in range(SPACING**2):
            grid = grid_of(*size)
            pixel, inside = spaced_pixels(grid, SPACING, mi.UInt32(number))
            there = np.array(inside)
            chosen = np.array(pixel)[there]
            x, y = (np.array(value)[there] for value in grid.place(pixel))
            assert len(np.unique(x % SPACING)) <= 1
            assert len(np.unique(y % SPACING)) <= 1
            found += chosen.tolist()
        assert sorted(found) == list(range(size[0] * size[1]))


def post_temporal(name: str) -> tuple[Any, Any, Any]:
    """Scope, reservoirs and primary hits of a frame of candidates."""
    case = references.CASES[name]
    scene = case.load()
    renderer = integrator(case.max_depth, Mode({"temporal": False, "spatial": False}), mutations=1)
    renderer.render(scene, seed=3, spp=1)
    history = renderer._history
    scope = scope_of(renderer, scene, number=7, seed=7)
    return scope, history.reservoirs, history.hits


@pytest.mark.parametrize("updated", [False, True])
def test_each_set_sees_what_the_others_have_become(rgb, monkeypatch, updated):
    scope, before, hits = post_temporal("room")
    seen = []

    def recording(around: Surroundings, pixel: Any, weight: Any, blend: float) -> Any:
        seen.append((np.array(around.values), np.array(pixel), np.array(weight)))
        return energy_rule(around, pixel, weight, blend)

    monkeypatch.setattr(rule_module, "energy_rule", recording)
    plan = mutation_plan(3, STEP, energy_weight=1.0)
    rule = mutate_by_updated_energy if updated else mutate_by_energy
    after, mutated = rule(scope, before, hits, plan, mi.UInt32(0))
    shown = np.array(target(before.color) * before.weight)
    mixed = np.array(target(after.color) * before.weight)
    was, has_become = (v / (v + shown.mean()) for v in (shown, mixed))
    accepted, raised = np.array(mutated.accepted), np.array(mutated.raised)
    assert np.mean(accepted > 0) > 0.3
    assert 0.2 * accepted.sum() < raised.sum() < 0.8 * accepted.sum()
    assert len(seen) == (16 if updated else 1)
    moved = np.zeros(32 * 32, dtype=bool)
    for values, pixel, weight in seen:
        np.testing.assert_allclose(values, np.where(moved, has_become, was), rtol=1e-4, atol=1e-6)
        np.testing.assert_array_equal(weight, np.array(before.weight)[pixel])
        moved[pixel] = True
    assert moved.all()
    assert np.mean(abs(has_become - was) > 0.01) > 0.2


# ------------------------------ no hold on the image --------------------------------------------


@pytest.mark.parametrize(("rule", "weight"), [("energy", 0.5), ("energy_updated", 1.0)])
def test_the_luminance_of_a_pixel_does_not_change(rgb, rule, weight):
    """Invariance, as the frame shows it; and so the energy with the updated W does not change."""
    case = references.CASES["room"]
    scene = case.load()
    mode = Mode({"temporal": False, "spatial": False})
    # What will not be mutated is rounded otherwise.
    mutations: dict[str, Any] = {"mutations": 5, "mutation_step": STEP}
    other = integrator(5, mode, **mutations)
    plain = luminance(np.array(other.render(scene, seed=3, spp=1))[..., :3])
    renderer = integrator(
        5,
        mode,
        mutation_acceptance=rule,
        blue_noise_weight=weight,
        aovs="m:mutation",
        **mutations,
    )
    assert renderer.aov_names() == ["m.before", "m.after", "m.mixed"]
    image = np.array(renderer.render(scene, seed=3, spp=1))
    before, after, mixed = np.moveaxis(image[..., 3:], -1, 0)
    np.testing.assert_allclose(after, before, rtol=3e-5, atol=1e-12)
    np.testing.assert_allclose(luminance(image[..., :3]), plain, rtol=1e-4, atol=1e-7)

    mean = before.mean()
    was, updated, compared = (v / (v + mean) for v in (before, after, mixed))
    pixel = dr.arange(mi.UInt32, was.size)
    changes = [
        np.array(energy_change(around(was), pixel, *(mi.Float(lanes_of(a)) for a in (was, v))))
        for v in (updated, compared)
    ]
    # Of what is shown: rounding. Of what the rule compares: many temperatures.
    assert abs(changes[0]).max() < TEMPERATURE
    assert np.mean(abs(changes[1]) > 10 * TEMPERATURE) > 0.3


def test_the_rule_lowers_the_energy_of_what_is_never_shown(rgb):
    """The rule works, on the wrong image; up-to-date neighbours let it get further."""
    scene = references.CASES["room"].load()
    fallen = {}
    for name, extra in {
        "plain": {},
        **{rule: {"mutation_acceptance": rule, "blue_noise_weight": 1.0} for rule in RULES},
    }.items():
        renderer = integrator(5, reusing(1, **extra), aovs="mutation")
        energies = []
        for seed in range(8):
            image = np.array(renderer.render(scene, seed=seed, spp=1))
            before, _, mixed = np.moveaxis(image[..., 3:], -1, 0)
            mean = before.mean()
            energies.append([image_energy(v / (v + mean)).mean() for v in (before, mixed)])
        fallen[name] = np.mean(energies, axis=0) @ [1, -1]
    assert fallen["energy"] > fallen["plain"] + 0.1
    assert fallen["energy_updated"] > fallen["energy"] + 0.02


# ------------------------------ bias ------------------------------------------------------------


def reusing(frames: int, **extra: Any) -> Mode:
    """Five mutations between temporal reuse, if there are several frames, and spatial reuse."""
    parameters = {
        "temporal": frames > 1,
        "spatial_radius": 6.0,
        "mutations": 5,
        "mutation_step": STEP,
        **extra,
    }
    return Mode(parameters, frames=frames)


def image_bias(**extra: Any) -> BiasReport:
    """Test of the image after spatial reuse, at the suite's false-alarm rate."""
    case = references.CASES["grooves"]
    reference, variance = references.load("grooves")
    mode = reusing(1, **extra)
    renderer = integrator(case.max_depth, mode)
    return bias_report(independent_runs(renderer, case.load(), mode), 512, reference, variance)


def test_the_rule_biases_what_reuses_its_paths(rgb):
    report = image_bias(mutation_acceptance="energy", blue_noise_weight=0.5)
    print(report)
    assert not report.passed


def test_control_without_its_share_the_same_test_passes(rgb):
    report = image_bias(mutation_acceptance="energy", blue_noise_weight=0.0)
    assert report.passed, report
    assert report.detectable < 0.03


# ------------------------------ border ----------------------------------------------------------


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"mutation_acceptance": "energy"}, "needs mutations of at least 1, not 0"),
        ({"blue_noise_weight": 2.0}, "blue_noise_weight must be a number from 0 to 1, not 2"),
        (
            {"mutation_acceptance": "energy", "mutations": 1, "mutation_interval": 4},
            "mutates every pixel in every frame and needs mutation_interval=1, not 4",
        ),
        ({"blue_noise": "blue"}, "blue_noise must be one of none, selection, not 'blue'"),
        (
            {"mutation_acceptance": "blue"},
            "mutation_acceptance must be one of metropolis, energy, energy_updated, not 'blue'",
        ),
        (
            {"blue_noise": "mutation", "mutations": 1},
            "blue_noise must be one of none, selection, not 'mutation'; write "
            "mutation_acceptance='energy'",
        ),
        (
            {"blue_noise": "mutation_updated", "mutations": 1},
            "not 'mutation_updated'; write mutation_acceptance='energy_updated'",
        ),
    ],
)
def test_wrong_use_is_one_line(rgb, parameters, message):
    with pytest.raises((ValueError, RuntimeError)) as error:
        mi.load_dict({"type": "restir_pt", **parameters})
    assert message in str(error.value).splitlines()[-1]


def test_bias_is_named(rgb):
    scene = references.CASES["room"].load()
    for rule in ("metropolis", *RULES):
        renderer = integrator(5, reusing(1, mutation_acceptance=rule))
        renderer.render(scene, seed=1, spp=1)
        biased = rule in RULES
        named = renderer.statistics().get("biased", [])
        assert named == [f"mutation_acceptance={rule}"] * biased
        assert (f"biased by mutation_acceptance={rule}" in str(renderer)) == biased
    unbiased = integrator(5, reusing(1, mutation_acceptance="energy", blue_noise_weight=0.0))
    assert not unbiased.parameters.biased


@pytest.mark.parametrize("rule", RULES)
def test_what_is_accepted_and_what_is_shown_are_two_choices(rgb, rule):
    """Selection sees what the rule leaves: at weight 0 the same as without it, bit by bit."""
    scene = references.CASES["room"].load()
    images = []
    for extra in (
        {},
        {"mutation_acceptance": rule, "blue_noise_weight": 0.0},
        {"mutation_acceptance": rule, "blue_noise_weight": 1.0},
    ):
        renderer = integrator(5, reusing(3, blue_noise="selection", **extra))
        images.append([np.array(renderer.render(scene, seed=s, spp=1)) for s in range(3)])
    np.testing.assert_array_equal(images[1], images[0])
    assert not np.array_equal(images[2], images[0])
    assert renderer.statistics()["biased"] == [
        f"mutation_acceptance={rule}",
        "blue_noise=selection",
    ]


def test_share_of_mutations_that_raise_the_target_function(rgb):
    scene = references.CASES["room"].load()
    renderer = integrator(5, reusing(3))
    for seed in range(3):
        renderer.render(scene, seed=seed, spp=1)
    for entry in renderer.statistics()["mutations"].values():
        if entry["acceptance"] * entry["share"] > 0.02:
            # Detailed balance: as much upwards as downwards. The chains are nearly in equilibrium.
            assert entry["raised"] + entry["lowered"] <= 1 + 1e-9
            assert entry["raised"] == pytest.approx(entry["lowered"], abs=0.1)


@pytest.mark.parametrize("rule", RULES)
def test_no_kernel_is_compiled_after_the_first_frames(rgb, rule):
    scene = references.CASES["room"].load()
    renderer = integrator(5, reusing(3, mutation_acceptance=rule))
    for seed in range(2):
        renderer.render(scene, seed=seed, spp=1)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        for seed in range(2, 4):
            renderer.render(scene, seed=seed, spp=1)
        history = dr.kernel_history([dr.KernelType.JIT])
    assert history
    assert all(entry["cache_hit"] for entry in history)


# ------------------------------ study -----------------------------------------------------------


def test_numbers_of_a_frame():
    """White errors of known power, and mutations that change nothing but the mixed image."""
    rng = np.random.default_rng(6)
    level = np.full((64, 64, 3), 2.0)
    reference = ReferenceImage(level, np.zeros_like(level))
    white = rng.standard_normal((3, 64, 64))
    shown, before, mixed = (2 * (1 + s * w) for s, w in zip((0.1, 0.2, 0.4), white, strict=True))
    mixed = np.abs(mixed)
    found = numbers(np.dstack([shown, shown, shown, before, before, mixed]), reference)
    for name, power in (("shown", 0.01), ("before spatial reuse", 0.04)):
        # The constant that the relative error adds to the reference is 1 % of its mean.
        assert found[f"power 0.25-0.5, {name}"] == pytest.approx(power / 1.01**2, rel=0.15)
        assert found[f"mean of the clipped error, {name}"] == pytest.approx(0, abs=0.02)
    assert found["power 0.25-0.5, mixed"] > found["power 0.25-0.5, before spatial reuse"]
    assert found["energy, mixed"] < found["energy, before spatial reuse"] < found["energy, shown"]
    assert found["largest change of luminance by mutations"] == 0
    noisy = ReferenceImage(level, np.full_like(level, 0.15**2))
    surer = numbers(np.dstack([shown, shown, shown, before, before, mixed]), noisy)
    excess = (0.15 / 2.02) ** 2
    for band in ("power 0.02-0.06, mixed", "power 0.25-0.5, before spatial reuse"):
        assert surer[band] == pytest.approx(found[band] - excess)
    changed = np.dstack([shown, shown, shown, before, 1.25 * before, mixed])
    change = numbers(changed, reference)["largest change of luminance by mutations"]
    assert change == pytest.approx(0.25)


@pytest.mark.slow
def test_the_study_runs(tmp_path):
    """A tiny version, with a rendered reference: the spectra are measured in other processes."""
    study = quick(on_scene(load_study("blue_noise_rule"), "cornell"))
    study = replace(study, sizes=((48, 27),), runs=2, warmup=1)
    kept = ("mutations_5", "stale_05", "updated_1")
    study = without(study, [name for name in study.variants if name not in kept])
    table = run_study(study, tmp_path / "out").csv()
    for name in ("power 0.06-0.17, mixed", "largest change of luminance by mutations", "raised"):
        assert name in table
