"""Frames as a user sees them: repeatable, never invalid, never recompiled, with clear errors."""

from __future__ import annotations

import warnings

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import zoo
from support import references, rooms
from support.modes import MODES
from support.runs import integrator

from mitsuba_restir.passes.temporal import YOUNG


def render(renderer, scene, seed=0, spp=1, sensor=0) -> np.ndarray:
    return np.array(renderer.render(scene, sensor=sensor, seed=seed, spp=spp))


@pytest.fixture
def room(rgb) -> mi.Scene:
    return references.CASES["room"].load()


# --------------------------------- repeats ------------------------------------------------------


@pytest.mark.parametrize("mode", ["candidates_4", "both"])
def test_equal_seeds_give_identical_sequences(room, mode):
    sequences = []
    renderer = integrator(5, MODES[mode])
    for other in (renderer, integrator(5, MODES[mode]), renderer):
        other.reset()
        sequences.append([render(other, room, seed=s) for s in (3, 3, 5)])
    for sequence in sequences[1:]:
        np.testing.assert_array_equal(sequence, sequences[0])


def test_frames_with_equal_seeds_differ(room):
    renderer = integrator(5, MODES["candidates_1"])
    a, b = (render(renderer, room, seed=3) for _ in range(2))
    assert np.mean(a != b) > 0.5


def test_seeds_differ(room):
    images = []
    renderer = integrator(5, MODES["candidates_1"])
    for seed in (1, 2):
        renderer.reset()
        images.append(render(renderer, room, seed=seed))
    assert np.mean(images[0] != images[1]) > 0.5


def test_mi_render_is_the_same(room):
    renderer = integrator(5, MODES["both"])
    a = np.array(mi.render(room, integrator=renderer, seed=1, spp=2))
    renderer.reset()
    np.testing.assert_array_equal(a, render(renderer, room, seed=1, spp=2))


# --------------------------------- kernels ------------------------------------------------------


@pytest.mark.parametrize("guiding", [False, True])
@pytest.mark.parametrize("mode", ["candidates_1", "both"])
def test_no_kernel_is_compiled_after_the_first_frames(room, mode, guiding):
    renderer = integrator(5, MODES[mode], guiding=guiding)
    sensor = room.sensors()[0]
    camera = mi.traverse(sensor)

    def frame(i: int) -> None:
        camera["to_world"] = mi.Transform4f(rooms.look([0.01 * i, 1.0, 3.4], [0, 0.9, 0]))
        camera.update()
        render(renderer, room, seed=i, spp=1 + i % 2, sensor=sensor)

    for i in range(2):
        frame(i)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        for i in range(2, 8):
            if i == 5:
                renderer.reset()
            frame(i)
        history = dr.kernel_history([dr.KernelType.JIT])
    assert history
    missed = [entry for entry in history if not entry["cache_hit"]]
    assert not missed, f"{len(missed)} of {len(history)} kernels were compiled again"


# --------------------------------- validity -----------------------------------------------------


@pytest.mark.parametrize("mode", ["spatial_3", "both_4", "both_distance"])
@pytest.mark.parametrize("name", ["room", "grooves", "far_room", *zoo.SCENES])
def test_no_invalid_values(rgb, name, mode):
    """No NaN, no infinity, nothing negative, in pixels, weights and records."""
    case = references.CASES[name]
    scene, chosen = case.load(), MODES[mode]
    renderer = integrator(case.max_depth, chosen)
    for seed in range(24):
        image = render(renderer, scene, seed=seed, spp=chosen.spp)
        assert np.isfinite(image).all(), f"frame {seed}: {np.argwhere(~np.isfinite(image))[:3]}"
        assert image.min() >= 0, seed
        reservoirs = renderer._history.reservoirs
        for value in (
            reservoirs.weight,
            reservoirs.color,
            reservoirs.confidence,
            reservoirs.path.radiance,
            reservoirs.path.factor,
        ):
            assert np.isfinite(np.array(value)).all()
            assert np.array(value).min() >= 0


def test_bitmap_on_an_area_light(rgb):
    """Dr.Jit 1.5 cannot record it; the frame must be rendered all the same."""
    light = zoo.emitters()["rectangle"] | {
        "emitter": {"type": "area", "radiance": zoo._texture(np.full((4, 4, 3), 0.5))}
    }
    scene = mi.load_dict(
        {"type": "scene", "sensor": rooms.sensor(), "light": light, "floor": {"type": "rectangle"}}
    )
    renderer = integrator(3, MODES["both"])
    assert all(np.isfinite(render(renderer, scene, seed=s)).all() for s in range(3))


# --------------------------------- history ------------------------------------------------------


def confidences(scene, steps) -> list[float]:
    """Mean confidence after each frame; ``steps`` name what happens before it."""
    renderer = mi.load_dict(
        {"type": "restir_pt", "spatial": False, "max_depth": 3, "confidence_cap": 4}
    )
    result = []
    for before in steps:
        if before == "reset":
            renderer.reset()
        current = scene[before] if before in scene else scene["first"]
        render(renderer, current)
        result.append(float(np.array(renderer._history.reservoirs.confidence).mean()))
    return result


def test_confidence_grows_to_the_cap_and_reset_clears_it(room):
    grown = confidences({"first": room}, ["", "", "", "", "", "", "reset", ""])
    np.testing.assert_allclose(grown[0], 1)
    assert grown[0] < grown[1] < grown[2] < grown[3]
    assert max(grown) <= 5 + 1e-6
    np.testing.assert_allclose(grown[6], 1)
    assert grown[7] > 1


def test_a_young_history_is_not_confident_beyond_its_trees(room):
    """Where neighbours' confidences are added up; 2 trees a frame."""
    renderer = mi.load_dict({"type": "restir_pt", "max_depth": 3, "spatial": True})
    temporal = []
    for seed in range(13):
        render(renderer, room, seed=seed, spp=2)
        handed_on = np.array(renderer._history.reservoirs.confidence)
        # With all of its 3 neighbours, a pixel hands on four times what it had after the merge.
        temporal.append(handed_on.max() / 4)
    most = [2 + min(YOUNG * 2 * frame, 20 * 2) for frame in range(13)]
    assert np.all(temporal <= np.array(most) + 1e-3)
    # Nearly all that is allowed; their sums would be at the cap after two frames.
    assert np.all(temporal[1:] >= 0.7 * np.array(most[1:]))


def test_another_scene_starts_a_new_history(room):
    other = references.CASES["open_room_moved"].load()
    grown = confidences({"first": room, "other": other}, ["", "", "other", "other", ""])
    np.testing.assert_allclose([grown[0], grown[2], grown[4]], 1)
    assert min(grown[1], grown[3]) > 1


@pytest.mark.parametrize("change", ["size", "type"])
def test_another_film_or_sensor_starts_a_new_history(room, change):
    description = rooms.sensor(lens=change == "type")
    if change == "size":
        description["film"]["width"] = 24
    other = mi.load_dict(description)
    renderer = mi.load_dict({"type": "restir_pt", "spatial": False, "max_depth": 3})
    for _ in range(2):
        render(renderer, room)
    assert renderer.statistics()["matched"] > 0.5
    image = render(renderer, room, sensor=other)
    assert image.shape[:2] == ((32, 24) if change == "size" else (32, 32))
    assert renderer.statistics()["matched"] == 0


def test_orthographic_sensor_warns_once_and_renders(room):
    description = rooms.sensor() | {"type": "orthographic"}
    del description["fov"]
    description["to_world"] = rooms.look([0, 1, 3], [0, 1, 0])
    sensor = mi.load_dict(description)
    renderer = integrator(4, MODES["both"])
    with pytest.warns(UserWarning, match="cannot be re-projected"):
        render(renderer, room, sensor=sensor)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        image = render(renderer, room, sensor=sensor)
    assert np.isfinite(image).all()


def test_static_camera_finds_its_history(room):
    renderer = integrator(5, MODES["temporal"])
    for _ in range(2):
        render(renderer, room)
    statistics = renderer.statistics()
    assert statistics["matched"] > 0.95
    assert statistics["temporal"]["ok"] > 0.8


# --------------------------------- auxiliary images ---------------------------------------------

AOVS = "albedo:albedo, nn:sh_normal, depth:depth, pos:position, motion:motion, confidence"
NAMES = [
    *(f"albedo.{c}" for c in "RGB"),
    *(f"nn.{c}" for c in "XYZ"),
    "depth.T",
    *(f"pos.{c}" for c in "XYZ"),
    "motion.X",
    "motion.Y",
    "confidence.C",
]


def test_auxiliary_images(room):
    """Names and values as Mitsuba's ``aov`` has them, at many samples."""
    renderer = mi.load_dict({"type": "restir_pt", "max_depth": 2, "aovs": AOVS})
    assert renderer.aov_names() == NAMES
    frames = [render(renderer, room, seed=s) for s in range(32)]
    ours = np.mean(frames, axis=0)[..., 3:]
    reference = mi.load_dict(
        {"type": "aov", "aovs": "albedo:albedo, nn:sh_normal, depth:depth, pos:position"}
    )
    theirs = np.array(mi.render(room, integrator=reference, spp=256))[..., -10:]
    difference = np.abs(ours[..., :10] - theirs)
    # Pixels at edges differ by noise; the others by their sub-pixel positions alone.
    assert np.quantile(difference, 0.9) < 0.03
    assert difference.mean() < 0.05
    last = frames[-1][..., 3:]
    assert np.abs(last[..., 10:12]).max() < 1e-2  # a static camera moves nothing
    assert last[..., 12].mean() > 20


def test_the_first_round_is_the_frame_of_one_round(room):
    """Light seen directly included, and whatever comes after it; the candidates, without rounds."""
    common = {"type": "restir_pt", "max_depth": 5, "temporal": False}
    one, three, none = (
        mi.load_dict({**common, "aovs": "first_round", **more})
        for more in ({}, {"spatial_rounds": 3}, {"spatial": False})
    )
    plain = render(mi.load_dict(common), room)
    for renderer in (one, three):
        np.testing.assert_array_equal(render(renderer, room)[..., 3:], plain)
    own = render(none, room)
    np.testing.assert_array_equal(own[..., 3:], own[..., :3])
    assert np.abs(own[..., :3] - plain).max() > 0.1


def test_motion_vectors(room):
    """A camera that turns by a pixel moves the image by a pixel."""
    renderer = mi.load_dict({"type": "restir_pt", "max_depth": 2, "aovs": "motion"})
    camera = mi.traverse(room.sensors()[0])
    render(renderer, room)
    before = mi.ScalarTransform4f(rooms.look(*rooms.CAMERA))
    pixel = 2 * np.tan(np.radians(20)) / rooms.SIZE
    camera["to_world"] = mi.Transform4f(
        before @ mi.ScalarTransform4f().rotate([0, 1, 0], float(np.degrees(np.arctan(pixel))))
    )
    camera.update()
    motion = render(renderer, room)[..., 3:]
    np.testing.assert_allclose(np.abs(np.median(motion[..., 0])), 1, atol=0.1)
    np.testing.assert_allclose(np.median(motion[..., 1]), 0, atol=0.05)


# --------------------------------- errors -------------------------------------------------------


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"mutationz": 1}, "restir_pt has no parameter 'mutationz'; it has preset, max_depth, "),
        ({"max_depth": -2}, "max_depth must be an integer of at least -1"),
        ({"rr_depth": 0}, "rr_depth must be"),
        ({"spatial_neighbors": 0}, "spatial_neighbors must be an integer from 1"),
        ({"spatial_rounds": 99}, "spatial_rounds must be"),
        ({"spatial_radius": 0.0}, "spatial_radius must be"),
        ({"confidence_cap": -1.0}, "confidence_cap must be"),
        ({"shift": "sideways"}, "shift must be one of hybrid, reconnection, random_replay"),
        ({"connectability": "always"}, "connectability must be one of"),
        ({"temporal": 1}, "temporal must be true or false"),
        ({"aovs": "nonsense"}, "aovs must be"),
        ({"no_such_parameter": 1}, "no_such_parameter"),
    ],
    ids=lambda p: next(iter(p)) if isinstance(p, dict) else "",
)
def test_bad_parameters(rgb, parameters, message):
    with pytest.raises((ValueError, RuntimeError)) as error:
        mi.load_dict({"type": "restir_pt", **parameters})
    assert message in str(error.value)


def test_media_are_refused(rgb):
    scene = mi.load_dict(
        {
            "type": "scene",
            "sensor": rooms.sensor(),
            "fog": {
                "type": "sphere",
                "bsdf": {"type": "null"},
                "interior": {"type": "homogeneous"},
            },
        }
    )
    with pytest.raises(ValueError, match="participating medium"):
        render(integrator(3, MODES["both"]), scene)


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        ({"type": "radiancemeter", "film": {"type": "hdrfilm", "width": 1, "height": 1}}, "pixel"),
        (
            {
                "type": "batch",
                "one": {"type": "perspective"},
                "two": {"type": "perspective"},
                "film": {"type": "hdrfilm", "width": 8, "height": 4, "rfilter": {"type": "box"}},
            },
            "batch",
        ),
    ],
    ids=["one pixel", "batch"],
)
def test_sensors_without_a_pixel_grid_are_refused(room, sensor, message):
    if "film" in sensor:
        sensor["film"]["rfilter"] = {"type": "box"}
    with pytest.raises(ValueError, match=message):
        render(integrator(3, MODES["both"]), room, sensor=mi.load_dict(sensor))


def test_wide_filters_are_warned_about(room):
    description = rooms.sensor()
    description["film"]["rfilter"] = {"type": "gaussian"}
    with pytest.warns(UserWarning, match="box"):
        render(integrator(3, MODES["both"]), room, sensor=mi.load_dict(description))
