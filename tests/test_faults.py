"""What once gave a wrong picture, lost work or a traceback, group by group."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir import camera_path, cli
from mitsuba_restir.errors import UsageError

# ------------------------------ words of the plugin ---------------------------------------------


def tiny() -> mi.Scene:
    film = {"type": "hdrfilm", "width": 4, "height": 4, "rfilter": {"type": "box"}}
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": {"type": "perspective", "film": film},
            "light": {"type": "constant"},
        }
    )


@pytest.mark.parametrize("seed", [-1, 2**32, 1.5, True, "3", None])
def test_a_seed_that_is_none_is_named(rgb, seed):
    renderer = mi.load_dict({"type": "restir_pt"})
    allowed = f"restir_pt: seed must be an integer from 0 to 4294967295, not {seed!r}"
    with pytest.raises(ValueError, match=allowed):
        renderer.render(tiny(), seed=seed, spp=1)


def test_a_seed_for_every_pixel_is_none(rgb):
    renderer = mi.load_dict({"type": "restir_pt"})
    with pytest.raises(ValueError, match="seed must be a single integer, not an array of 3"):
        renderer.render(tiny(), seed=mi.UInt32([1, 2, 3]), spp=1)


@pytest.mark.parametrize("spp", [-1, 2**32, 1.5, True, "3", None])
def test_an_spp_that_is_none_is_named(rgb, spp):
    renderer = mi.load_dict({"type": "restir_pt"})
    allowed = f"restir_pt: spp must be an integer from 0 to 4294967295, not {spp!r}"
    with pytest.raises(ValueError, match=allowed):
        renderer.render(tiny(), spp=spp)


def test_seeds_and_spp_of_every_integer_type_are_the_same(rgb):
    images = []
    for seed, spp in ((7, 2), (np.int64(7), np.uint8(2)), (mi.UInt32(7), 2), (mi.Int32(7), 2)):
        renderer = mi.load_dict({"type": "restir_pt"})
        images.append(np.array(renderer.render(tiny(), seed=seed, spp=spp)))
    for image in images[1:]:
        np.testing.assert_array_equal(image, images[0])
    mi.load_dict({"type": "restir_pt"}).render(tiny(), seed=2**32 - 1, spp=np.int64(0))


def test_the_number_of_samples_may_run_over(rgb):
    """Streams are named by 32 bits; a very long animation starts them again."""
    renderer = mi.load_dict({"type": "restir_pt"})
    scene = tiny()
    renderer.render(scene, spp=1)
    renderer._sample = 2**32 - 1
    images = [np.array(renderer.render(scene, spp=1)) for _ in range(2)]
    assert np.isfinite(images).all()


def test_an_integrator_of_another_variant_is_named(rgb):
    renderer, scene = mi.load_dict({"type": "restir_pt"}), tiny()
    renderer.render(scene, spp=1)
    try:
        mi.set_variant("llvm_ad_mono")
        other = tiny()
        for given in (scene, other):
            with pytest.raises(ValueError, match=r"made under llvm_ad_rgb.* now llvm_ad_mono"):
                renderer.render(given, spp=1)
        own = mi.load_dict({"type": "restir_pt"})
        with pytest.raises(ValueError, match=r"scene.* another variant than llvm_ad_mono"):
            own.render(scene, spp=1)
        with pytest.raises(ValueError, match=r"sensor.* another variant than llvm_ad_mono"):
            own.render(other, sensor=scene.sensors()[0], spp=1)
        assert own.render(other, spp=1).shape == (4, 4, 1)
    finally:
        mi.set_variant("llvm_ad_rgb")
    assert renderer.render(scene, spp=1).shape == (4, 4, 3)


@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, pickle.dumps], ids=["copy", "deepcopy", "pickle"]
)
def test_an_integrator_is_not_copied(rgb, duplicate: Callable[[Any], Any]):
    renderer = mi.load_dict({"type": "restir_pt"})
    with pytest.raises(TypeError, match=r"restir_pt: .* make another one with mi.load_dict"):
        duplicate(renderer)


# ------------------------------ camera paths ----------------------------------------------------


def turn(degrees: float, frames: int, **more: Any) -> camera_path.CameraPath:
    """A camera that turns on the spot, given at both ends."""
    far = [1 + 2 * np.sin(np.radians(degrees)), 1.0, 1 + 2 * np.cos(np.radians(degrees))]
    start = {"frame": 0, "origin": [1.0, 1.0, 1.0], "target": [1.0, 1.0, 3.0]}
    end = {"frame": frames - 1, "origin": [1.0, 1.0, 1.0], "target": far, **more}
    return camera_path.from_data({"keyframes": [start, end]})


def test_a_half_turn_is_refused_and_the_frame_is_named():
    """Halfway the target is where the camera is, so that it looks nowhere."""
    with pytest.raises(UsageError, match=r"frame 3, between keyframes 0 and 1, .*180 degrees"):
        turn(180, 7).check(7)


def test_only_frames_that_are_rendered_matter():
    turn(180, 8).check(8)  # nowhere between frames 3 and 4
    turn(180, 7).check(3)
    turn(179, 7).check(7)
    turn(180, 7).check(0)


def test_a_camera_that_turns_over_or_looks_along_up_is_refused():
    with pytest.raises(UsageError, match=r"frame 3, between keyframes 0 and 1"):
        turn(90, 7, up=[0, -1, 0]).check(7)
    below = {"frame": 0, "origin": [0, 0, 0], "target": [1, -1, 0]}
    above = {"frame": 2, "origin": [0, 0, 0], "target": [-1, 3, 0]}
    middle = {"frame": 5, "origin": [0, 0, 0], "target": [-1, 3, 1]}
    with pytest.raises(UsageError, match=r"frame 1, between keyframes 0 and 1"):
        camera_path.from_data({"keyframes": [below, above, middle]}).check(6)


def test_frames_beyond_the_last_keyframe_are_its():
    path = turn(90, 3)
    path.check(10**9)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_rounding_does_not_hide_a_frame_without_view(scale):
    """Means of floats are not exact: what is left of the view is noise, at every scale."""
    origin = scale * np.array([0.1, 0.7, 0.3])
    view = scale * np.array([0.3, 0.1, 0.9])
    keys = [
        {"frame": frame, "origin": origin.tolist(), "target": (origin + sign * view).tolist()}
        for frame, sign in ((0, 1), (6, -1), (7, -1))
    ]
    with pytest.raises(UsageError, match="frame 3,"):
        camera_path.from_data({"keyframes": keys}).check(8)


def test_nothing_is_rendered_of_a_path_with_such_a_frame(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    lines = [
        f"[[keyframes]]\nframe = {frame}\norigin = [3.5, 1.6, -2.3]\ntarget = [{x}, 1.6, -2.3]"
        for frame, x in ((0, 2.5), (4, 4.5))
    ]
    (tmp_path / "path.toml").write_text("\n".join(lines))
    arguments = ["render", "ajar", "--resolution", "16x9", "--camera-path", "path.toml"]
    assert cli.main([*arguments, "-o", "film/"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "argument --camera-path: frame 2, between keyframes 0 and 1" in error
    assert [entry.name for entry in tmp_path.iterdir()] == ["path.toml"]
