"""Animations: their files, what is between keyframes, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir import curves, sequence
from mitsuba_restir.errors import UsageError
from mitsuba_restir.transforms import is_rigid, matrix_of

TURN = {"axis": [0, 2, 0], "angle": 90}
TRACK = {
    "parameter": "box.to_world",
    "keyframes": [{"frame": 0}, {"frame": 4, "translate": [1, 0, 0], "rotate": TURN}],
}
COLOUR = {
    "parameter": "lamp.intensity.value",
    "keyframes": [{"frame": 0, "value": [0, 1, 2]}, {"frame": 2, "value": [2, 1, 0]}],
}
CAMERA = [{"frame": 0, "origin": [0, 0, 5], "target": [0, 0, 0]}]


def scene() -> mi.Scene:
    place = mi.ScalarTransform4f().translate([3, 0, 0])
    return mi.load_dict(
        {
            "type": "scene",
            "camera": {"type": "perspective"},
            "lamp": {
                "type": "point",
                "position": [0, 3, 0],
                "intensity": {"type": "rgb", "value": 1.0},
            },
            "ball": {"type": "sphere", "to_world": place},
            "box": {"type": "cube", "to_world": place},
        }
    )


def bound(*tracks: Any, **more: Any) -> tuple[Any, Any]:
    made = scene()
    return mi.traverse(made), sequence.from_data({"tracks": list(tracks), **more}).bind(made)


def test_a_camera_path_is_an_animation(rgb, tmp_path):
    """Files of earlier versions."""
    text = "[[keyframes]]\nframe = 0\norigin = [0, 0, 5]\ntarget = [0, 0, 0]\nfov = 40\n"
    (tmp_path / "a.toml").write_text(text)
    (tmp_path / "a.json").write_text(json.dumps({"keyframes": [{**CAMERA[0], "fov": 40}]}))
    for name in ("a.toml", "a.json"):
        animation = sequence.load(tmp_path / name)
        assert (animation.length, animation.tracks) == (1, ())
        placed = animation.bind(made := scene())
        assert not placed.edits_scene
        placed(0)
        sensor = mi.traverse(made.sensors()[0])
        np.testing.assert_allclose(matrix_of(sensor)[:3, 3], [0, 0, 5])
        np.testing.assert_allclose(float(sensor["x_fov"][0]), 40)


def test_objects_turn_about_themselves(rgb):
    """A mesh, whose vertices move, and a sphere, which has a transform."""
    parameters, place = bound(TRACK, {**TRACK, "parameter": "ball.to_world"})
    corners = np.array(parameters["box.vertex_positions"]).reshape(-1, 3)
    normals = np.array(parameters["box.vertex_normals"]).reshape(-1, 3)
    place(2)
    half = np.radians(45)
    turn = np.array([[np.cos(half), 0, np.sin(half)], [0, 1, 0], [-np.sin(half), 0, np.cos(half)]])
    moved = (corners - [3, 0, 0]) @ turn.T + [3.5, 0, 0]
    np.testing.assert_allclose(
        np.array(parameters["box.vertex_positions"]).reshape(-1, 3), moved, atol=1e-5
    )
    np.testing.assert_allclose(
        np.array(parameters["box.vertex_normals"]).reshape(-1, 3), normals @ turn.T, atol=1e-5
    )
    ball = matrix_of(parameters, "ball.to_world")
    np.testing.assert_allclose(ball[:3, 3], [3.5, 0, 0], atol=1e-6)
    np.testing.assert_allclose(ball[:3, :3], turn, atol=1e-6)
    place(0)
    np.testing.assert_allclose(
        np.array(parameters["box.vertex_positions"]).reshape(-1, 3), corners, atol=1e-6
    )


def test_a_pivot_is_turned_about(rgb):
    keys = [{"frame": 0, "rotate": {"axis": [0, 0, 1], "angle": 90}}]
    parameters, place = bound({"parameter": "ball.to_world", "pivot": [2, 0, 0], "keyframes": keys})
    place(0)
    np.testing.assert_allclose(matrix_of(parameters, "ball.to_world")[:3, 3], [2, 1, 0], atol=1e-6)


def test_values(rgb):
    parameters, place = bound(
        COLOUR, {"parameter": "camera.x_fov", "keyframes": [{"time": 0, "value": 30}]}
    )
    place(1)
    np.testing.assert_allclose(np.ravel(parameters["lamp.intensity.value"]), [1, 1, 1])
    np.testing.assert_allclose(np.ravel(parameters["camera.x_fov"]), 30)


def test_smooth_curves():
    """Points move without jumps of speed; colours stay between their keyframes; ends are held."""
    times, values = np.array([0.0, 1.0, 4.0]), np.array([[0.0], [1.0], [1.0]])
    fine = np.linspace(0, 4, 4001)
    for through, overshoots in ((curves.points, True), (curves.numbers, False)):
        curve = through(times, values, "smooth")
        found = curve(fine)[:, 0]
        np.testing.assert_allclose(curve(times), values, atol=1e-12)
        assert np.abs(np.diff(found, 2)).max() < 1e-5
        assert (found.max() > 1 + 1e-6) == overshoots
        assert curve(9.0) == curve(4.0)
        straight = through(times, values, "linear")(fine)[:, 0]
        assert np.abs(np.diff(straight, 2)).max() > 5e-4


def test_rigid():
    turned = np.array([[0.0, -1, 0, 5], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    assert is_rigid(turned)
    assert not is_rigid(turned @ np.diag([1, 1, 1.01, 1]))
    assert not is_rigid(turned @ np.diag([1, 1, -1, 1]))


@pytest.mark.parametrize(
    ("data", "word"),
    [
        ([], "keyframes"),
        ({}, "keyframes"),
        ({"tracks": []}, "at least one"),
        ({"tracks": "x"}, "must be a list"),
        ({"tracks": [TRACK], "speed": 1}, "speed"),
        ({"tracks": [TRACK], "interpolation": "cubic"}, "smooth, linear, not 'cubic'"),
        ({"tracks": [3]}, "track 0 needs a 'parameter'"),
        ({"tracks": [TRACK, TRACK]}, "more than one track"),
        ({"tracks": [{**TRACK, "speed": 2}]}, "speed"),
        ({"tracks": [{**TRACK, "keyframes": []}]}, "at least one"),
        ({"tracks": [{**TRACK, "keyframes": [3]}]}, "keyframe 0 must be a table"),
        ({"tracks": [{**TRACK, "keyframes": [{"frame": 0, "value": 3}]}]}, "value"),
        ({"tracks": [{**TRACK, "keyframes": [{"frame": 0, "translate": [0]}]}]}, "three numbers"),
        ({"tracks": [{**TRACK, "keyframes": [{"frame": 0, "rotate": 90}]}]}, "axis and angle"),
        (
            {
                "tracks": [
                    {**TRACK, "keyframes": [{"frame": 0, "rotate": {**TURN, "axis": [0] * 3}}]}
                ]
            },
            "axis must not be zero",
        ),
        ({"tracks": [{**TRACK, "keyframes": [{"frame": 0, "scale": 0}]}]}, "scale must be above 0"),
        (
            {
                "tracks": [
                    {
                        **TRACK,
                        "keyframes": [{"frame": 0}, {"frame": 1, "rotate": {**TURN, "angle": 360}}],
                    }
                ]
            },
            "180 degrees or more",
        ),
        ({"tracks": [{**COLOUR, "pivot": [0, 0, 0]}]}, "pivot"),
        ({"tracks": [{**COLOUR, "keyframes": [{"frame": 0}]}]}, "needs a 'value'"),
        ({"tracks": [{**COLOUR, "keyframes": [{"frame": 0, "value": "red"}]}]}, "finite number"),
        (
            {
                "tracks": [
                    {
                        **COLOUR,
                        "keyframes": [{"frame": 0, "value": 1}, {"frame": 1, "value": [1, 2, 3]}],
                    }
                ]
            },
            "different lengths",
        ),
        ({"tracks": [{**COLOUR, "keyframes": [{"frame": 1, "value": 1}] * 2}]}, "increase"),
        ({"keyframes": CAMERA, "tracks": [TRACK], "fps": -1}, "fps"),
    ],
)
def test_wrong_animations_are_refused(data, word):
    with pytest.raises(UsageError, match=word) as refusal:
        sequence.from_data(data)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("track", "word"),
    [
        ({**TRACK, "parameter": "bax.to_world"}, "there is box.to_world"),
        ({**COLOUR, "parameter": "lamp.intensity"}, "there is lamp.intensity.value"),
        (
            {**COLOUR, "keyframes": [{"frame": 0, "value": [1, 2]}]},
            "needs 3 numbers in a value, not 2",
        ),
    ],
)
def test_what_the_scene_has_not_is_refused(rgb, track, word):
    with pytest.raises(UsageError, match=word):
        sequence.from_data({"tracks": [track]}).bind(scene())


@pytest.mark.parametrize(("name", "text"), [("a.json", "{"), ("a.toml", "= 3"), ("a.yaml", "")])
def test_wrong_files_are_refused(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(UsageError, match=name):
        sequence.load(tmp_path / name)
    with pytest.raises(UsageError, match="cannot read"):
        sequence.load(Path("none.toml"))
