"""Light that hostile scenes lost or invented: tiny and distant scenes, masks, values not finite.

Each test is for a wrong picture that was once rendered without a word.
"""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats
from support import references, rooms
from support.bias import BiasReport
from support.finite import not_finite, poisoned
from support.modes import MODES, Mode
from support.mutants import Mutation, apply
from support.runs import ALPHA, assert_unbiased, bias_report, independent_runs, integrator
from support.scopes import mutation_plan
from support.stationarity import stationarity_report
from support.transport import transport_report
from test_unbiased import check
from zoo import _texture as texture

from mitsuba_restir.neighbors.color_history import DOUBTED, ColorHistory, clamped, remember
from mitsuba_restir.paths.grid import grid_of
from mitsuba_restir.paths.record import Form
from mitsuba_restir.resampling.mis import canonical_share, share
from mitsuba_restir.resampling.reservoir import empty_streaming, finalize, fits, is_sound, offer

pytestmark = pytest.mark.usefixtures("one_thread")

# --------------------------------- the offset of rays -------------------------------------------

CORNERS = ["corner_small", "corner_away"]

ROUNDS = Mode({"spatial_rounds": 5, "spatial_radius": 6.0}, frames=3)
SHIFTS = {
    "hybrid": {},
    "distance": {"connectability": "distance_roughness"},
    "reconnection": {"shift": "reconnection"},
    "replay": {"shift": "random_replay"},
}

ON_THE_SURFACE = (Mutation("si.spawn_ray_to(p).o", "si.p"),)
"""A reconnection that starts where no traced ray does."""


def transport(name: str, shift: str, runs: int = 512):
    reference, _ = references.load(name)
    case = references.CASES[name]
    return transport_report(case, (0, 5), runs, reference, **SHIFTS[shift])


def stationarity(name: str):
    reference, _ = references.load(name)
    plan = mutation_plan(3, 0.05)
    return stationarity_report(references.CASES[name], (0, 5), 512, reference, plan)


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize("name", CORNERS)
def test_transport_in_corners(rgb, name, shift):
    """Directions, distances and visibility are those of rays that start off their surface."""
    assert_unbiased(transport(name, shift), f"transport-{name}-{shift}", 0.01)


@pytest.mark.parametrize("mode", ["candidates_4", "temporal", "both", "rounds"])
@pytest.mark.parametrize("name", CORNERS)
def test_image_of_corners(rgb, name, mode):
    chosen = ROUNDS if mode == "rounds" else mode
    check(name, chosen, 256, 0.02, label=f"{name}-{mode}")


@pytest.mark.parametrize("name", CORNERS)
def test_mutations_in_corners(rgb, name):
    assert_unbiased(stationarity(name), f"stationarity-{name}", 0.01)


@pytest.mark.parametrize("name", CORNERS)
def test_a_connection_on_the_surface_is_seen(rgb, monkeypatch, name):
    """The control of the tests above."""
    apply(monkeypatch, ON_THE_SURFACE)
    assert not transport(name, "hybrid", 256).passed
    assert not stationarity(name).passed


# --------------------------------- values that are not finite -----------------------------------


def textured_room(value: float) -> mi.Scene:
    """The room with one texel of the given albedo in its diffuse floor."""
    texels = np.full((16, 16, 3), 0.5)
    texels[8, 8] = value
    description = rooms.room()
    floor = {"type": "diffuse", "reflectance": texture(texels, raw=True)}
    description["floor"]["bsdf"] = {"type": "twosided", "nested": floor, "id": "floor_bsdf"}
    return mi.load_dict(description)


def mend(scene: mi.Scene) -> None:
    parameters = mi.traverse(scene)
    (key,) = [key for key in parameters.keys() if key.endswith("reflectance.data")]
    parameters[key] = mi.TensorXf(np.full((16, 16, 3), 0.5, np.float32))
    parameters.update()


HOSTILE = {
    "both": {},
    "rounds": {"spatial_rounds": 3},
    "ranked": {"neighbor_sampling": "blue_noise"},
    "scored": {"neighbor_sampling": "geometry"},
    "mutations": {"mutations": 2},
    "selection": {"blue_noise": "selection", "retrace_history": True},
}


@pytest.mark.parametrize("value", [np.inf, np.nan])
@pytest.mark.parametrize("mode", HOSTILE)
def test_an_infinite_texel_stays_where_it_is(rgb, mode, value):
    """As many pixels are not finite as with ``path``, none once the texel is mended.

    The numbers of pixels are compared by the normal approximation of two Poisson counts, of about
    150 each: that ours are too many, or too few, is seen from a third on.
    """
    scene = textured_room(value)
    path = mi.load_dict({"type": "path", "max_depth": 5})
    renderer = integrator(5, MODES["both"], **HOSTILE[mode])
    theirs = sum(not_finite(mi.render(scene, integrator=path, seed=i, spp=1)) for i in range(24))
    ours = counted = 0
    for i in range(24):
        ours += not_finite(renderer.render(scene, seed=i, spp=1))
        counted += renderer.statistics()["not_finite"]
        assert poisoned(renderer) == 0
    print(f"{mode}, {value}: {ours} pixels, path {theirs}; {counted} values refused")
    assert theirs > 100
    assert counted >= ours
    assert abs(ours - theirs) < stats.norm.isf(ALPHA / 2) * (ours + theirs) ** 0.5

    mend(scene)
    for i in range(3):
        assert not_finite(renderer.render(scene, seed=i, spp=1)) == 0
        assert renderer.statistics()["not_finite"] == 0


def test_a_candidate_that_is_taken_all_the_same_is_seen(rgb, monkeypatch):
    """The control: were it not refused, it would be in the history after one frame."""
    apply(monkeypatch, (Mutation(" & fits(streaming, weight)", ""),))
    apply(monkeypatch, (Mutation("(total == 0) | (", "(total >= 0) | ("),))
    scene = textured_room(np.inf)
    renderer = integrator(5, MODES["both"])
    for i in range(4):
        renderer.render(scene, seed=i, spp=1)
    assert poisoned(renderer) > 0


def bright_room(exponent: int) -> mi.Scene:
    """The room, 2^exponent times as bright."""
    description = rooms.room()
    lights = [(description["light"]["emitter"], "radiance"), (description["lamp"], "intensity")]
    for plugin, key in lights:
        plugin[key] = {**plugin[key], "value": [2.0**exponent * x for x in plugin[key]["value"]]}
    return mi.load_dict(description)


BRIGHT = {name: extra for name, extra in HOSTILE.items() if name != "selection"}


@pytest.mark.parametrize("mode", BRIGHT)
def test_brightness_is_a_factor(rgb, mode):
    """With 10^20 times the light, the same picture, bit by bit; with 10^36 times, finite.

    Only the products of confidences, weights and Jacobians reach the end of single precision then:
    what they concern is refused and counted.
    """
    pictures = {}
    for exponent in (0, 66, 120):
        scene = bright_room(exponent)
        renderer = integrator(5, MODES["both"], **BRIGHT[mode])
        pictures[exponent] = np.stack(
            [
                np.array(renderer.render(scene, seed=i, spp=1), np.float64) / 2.0**exponent
                for i in range(12)
            ]
        )
        refused = renderer.statistics()["not_finite"]
        print(f"{mode}, 2^{exponent}: {refused} values refused")
        assert poisoned(renderer) == 0
        assert refused == 0 or exponent == 120
    np.testing.assert_array_equal(pictures[66], pictures[0])
    assert np.isfinite(pictures[120]).all()
    assert refused > 0
    np.testing.assert_allclose(pictures[120].mean(), pictures[0].mean(), rtol=0.01)


@pytest.mark.parametrize("weight", [np.inf, np.nan, 3e38])
def test_reservoirs_refuse_what_is_not_finite(rgb, weight):
    """An infinite weight, none at all, and one whose sum with the others is infinite."""
    one = dr.full(mi.UInt32, 1, 1)
    before = empty_streaming(Form(False, False))
    before = offer(before, before.path, mi.Color3f(2), mi.Float(2e38), mi.Float(0.5), one == 1)
    assert fits(before, mi.Float(1e38))[0]
    assert not fits(before, mi.Float(weight))[0]
    after = offer(before, before.path, mi.Color3f(9), mi.Float(weight), mi.Float(0.5), one == 1)
    assert after.total[0] == before.total[0]
    assert np.array(after.color).max() == 2


def test_a_weight_that_overflows_is_not_sound(rgb):
    streaming = empty_streaming(Form(False, False))
    assert is_sound(streaming.total, streaming.total)[0]
    for color, sound in ((1.0, True), (1e-36, False)):
        streaming.total, streaming.color = mi.Float(1e10), mi.Color3f(color)
        reservoir = finalize(streaming, 1, mi.Float(1))
        assert is_sound(reservoir.weight, streaming.total)[0] == sound


def test_shares_are_a_partition_where_they_overflow(rgb):
    big = mi.Float(3e38)
    assert np.isnan(share(big, big)[0])
    assert canonical_share(big, big)[0] == 1
    assert canonical_share(mi.Float(1), mi.Float(3))[0] == 0.25


def test_the_color_history_forgets_what_is_not_finite(rgb):
    """Of three pixels, two are not finite: one in this frame, one by the square of its values."""
    past = ColorHistory(mi.Color3f(1), mi.Float(5), mi.Color3f(0), mi.UInt32(0))
    now = remember(past, mi.Color3f(mi.Float([2, np.inf, np.nan])))
    np.testing.assert_array_equal(np.array(now.color)[0, 1:], 1)
    assert np.array(now.color)[0, 0] > 1
    nobody = dr.zeros(mi.UInt32, 2)
    bright = mi.Color3f(mi.Float([1, 1e20]))
    past = replace(past, color=mi.Color3f(mi.Float([3, 3e20])))
    found = clamped(grid_of(2, 1), past, bright, nobody)
    np.testing.assert_array_equal(np.array(found.color)[0], np.float32([1, 3e20]))
    np.testing.assert_array_equal(np.array(found.frames), [DOUBTED, 5])


# --------------------------------- masks --------------------------------------------------------

OPACITY = 0.3
LAMP = np.array([0.3, 1.4, 1.5])


def masks(sky: float | None, black: bool = False) -> mi.Scene:
    """A screen of opacity 0.3, and others: a wall behind it, thin glass and a torn foil before it.

    All end inside the view. ``black``: they reflect nothing, and there is no lamp.
    """
    place = mi.ScalarTransform4f
    cloth = {"type": "diffuse", "reflectance": 0.0 if black else 0.6}
    torn = {"type": "checkerboard", "color0": 0.2, "color1": 0.9}
    bsdfs = {
        "screen": {"type": "mask", "opacity": OPACITY, "nested": cloth},
        "wall": {"type": "mask", "opacity": 0.8, "nested": cloth},
        "pane": {"type": "thindielectric", "specular_reflectance": 0.0 if black else 1.0},
        "foil": {
            "type": "mask",
            "opacity": torn,
            "nested": cloth if black else {"type": "conductor", "material": "Ag"},
        },
    }
    places = {
        "screen": place().translate([0, 0.9, 0]).scale([0.8, 0.7, 1]),
        "wall": place().translate([1.0, 1.0, -1]).scale([1, 0.6, 1]),
        "pane": place().translate([-0.5, 0.7, 1]).scale([0.2, 0.4, 1]),
        "foil": place().translate([0.4, 0.7, 1]).scale([0.2, 0.4, 1]),
    }
    view = rooms.sensor(fov=35.0)
    view["film"] |= {"width": 16, "height": 16, "pixel_format": "rgba"}
    scene: dict[str, Any] = {"type": "scene", "sensor": view}
    for name, bsdf in bsdfs.items():
        scene[name] = {"type": "rectangle", "to_world": places[name], "bsdf": bsdf}
    if not black:
        scene["lamp"] = {"type": "point", "position": LAMP.tolist(), "intensity": 3.0}
    if sky is not None:
        scene["sky"] = {"type": "constant", "radiance": sky}
    return mi.load_dict(scene)


@functools.cache
def path_batches(
    sky: float | None, depth: int, hide: bool = False, black: bool = False
) -> np.ndarray:
    """16 independent images of ``path`` with alpha, (16, H, W, 4)."""
    scene = masks(sky, black)
    path = mi.load_dict(
        {"type": "path", "max_depth": depth, "rr_depth": 1000, "hide_emitters": hide}
    )
    batches = [mi.render(scene, integrator=path, spp=512, seed=1000 + i) for i in range(16)]
    return np.stack([np.array(batch, dtype=np.float64) for batch in batches])


def mean_and_variance(batches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return batches.mean(axis=0), batches.var(axis=0, ddof=1) / len(batches)


@pytest.mark.parametrize("depth", [1, 2, 4])
@pytest.mark.parametrize("hide", [False, True])
@pytest.mark.parametrize("sky", [None, 0.5])
def test_alpha_is_coverage(rgb, sky, hide, depth):
    """As in ``path``: the share of rays that scatter by more than null lobes, or see the sky."""
    expected, variance = mean_and_variance(path_batches(sky, depth, hide)[..., 3:])
    scene = masks(sky)
    renderer = integrator(depth, MODES["both"], hide_emitters=hide)
    runs = (np.array(renderer.render(scene, seed=i, spp=2))[..., 3:] for i in range(512))
    report = bias_report(runs, 512, expected, variance)
    assert_unbiased(report, f"alpha-{sky}-{hide}-{depth}", 0.05)
    assert (expected.min() == 1) == (sky is not None and not hide)


MASKED = ["candidates_4", "spatial_3", "temporal", "both", "both_replay", "both_distance"]


@pytest.mark.parametrize("mode", MASKED)
def test_a_lamp_before_masks(rgb, mode):
    """Without a sky, what a lamp lights on a mask is what it is with a black sky.

    ``path`` gives nothing for a ray that only passed through null lobes and left the scene, though
    the light sampled on its way is reflected by the mask whether or not the ray goes on through it.
    A black sky makes it keep such rays.
    """
    expected, variance = mean_and_variance(path_batches(0.0, 4)[..., :3])
    chosen = MODES[mode]
    runs = independent_runs(integrator(4, chosen), masks(None), chosen)
    assert_unbiased(bias_report(runs, 256, expected, variance), f"masks-{mode}", 0.03)


ALONE = np.s_[6:8, 6:8]
"""Pixels that see the screen, with nothing before or behind it."""


def irradiance_of_the_screen() -> float:
    """What the lamp gives the screen in the pixels ``ALONE``, at 16 points each."""
    camera, target = (np.array(point) for point in rooms.CAMERA)
    sides = (np.arange(6, 8, 0.25) + 0.125) / 8 - 1
    x, y = np.meshgrid(sides, -sides)
    forward = (target - camera) / np.linalg.norm(target - camera)
    right = np.array([1.0, 0.0, 0.0])
    up = np.cross(right, forward)
    ray = np.tan(np.radians(35.0 / 2)) * (x[..., None] * right + y[..., None] * up) + forward
    to_lamp = LAMP - (camera - ray * (camera[2] / ray[..., 2:]))
    distance = np.linalg.norm(to_lamp, axis=-1)
    return float((3.0 * to_lamp[..., 2] / distance**3).mean())


def test_path_darkens_masks(rgb):
    """The control: a mask of opacity o reflects o rho E / pi, and ``path`` shows o times that."""
    found = path_batches(None, 2)[..., :3]
    expected, variance = mean_and_variance(path_batches(0.0, 2)[..., :3])
    assert not bias_report(iter(found), 16, expected, variance).passed
    reflected = OPACITY * 0.6 / np.pi * irradiance_of_the_screen()
    np.testing.assert_allclose(expected[ALONE].mean(), reflected, rtol=0.02)
    shown = found.mean(axis=0)[ALONE].mean()
    np.testing.assert_allclose(shown, OPACITY * reflected, rtol=0.04)


def hidden_sky_report(mode: str, runs: int = 256) -> BiasReport:
    """Against the image with its sky, less the sky that is seen straight through black masks."""
    seen, seen_variance = mean_and_variance(path_batches(0.5, 4)[..., :3])
    through, variance = mean_and_variance(path_batches(0.5, 4, black=True)[..., :3])
    chosen = MODES[mode]
    renderer = integrator(4, chosen, hide_emitters=True)
    found = independent_runs(renderer, masks(0.5), chosen)
    return bias_report(found, runs, seen - through, seen_variance + variance)


@pytest.mark.parametrize("mode", MASKED)
def test_the_sky_is_hidden_behind_masks(rgb, mode):
    assert_unbiased(hidden_sky_report(mode), f"hidden-{mode}", 0.05)


@pytest.mark.parametrize("where", ["head.scattered | (not", "si.is_valid() | scattered | (not"])
def test_a_sky_that_is_seen_through_masks_is_noticed(rgb, monkeypatch, where):
    """The control: not hidden from the shifts, and not from the candidates."""
    hidden = f"{where} mapping.hides_sky)"
    apply(monkeypatch, (Mutation(hidden, hidden.replace("(not mapping.hides_sky)", "True")),))
    assert not hidden_sky_report("both", 512).passed
