"""Camera paths: interpolation, and what is refused."""

import numpy as np
import pytest

from mitsuba_restir import camera_path
from mitsuba_restir.errors import UsageError

START = {"frame": 0, "origin": [0, 0, 0], "target": [0, 0, 1], "fov": 40}
END = {"frame": 4, "origin": [4, 0, 0], "target": [0, 0, 9], "up": [1, 0, 0], "fov": 60}


def test_poses_are_interpolated_and_held_at_the_ends():
    path = camera_path.from_data({"keyframes": [START, END]})
    assert path.length == 5
    middle = path.pose(2)
    np.testing.assert_allclose(middle.origin, [2, 0, 0])
    np.testing.assert_allclose(middle.target, [0, 0, 5])
    np.testing.assert_allclose(middle.up, [0.5, 0.5, 0])
    assert middle.fov == 50
    np.testing.assert_allclose(path.pose(9).origin, [4, 0, 0])


def test_seconds_become_frames():
    late = {**END, "time": 2.0}
    del late["frame"]
    assert camera_path.from_data({"fps": 10, "keyframes": [START, late]}).length == 21


@pytest.mark.parametrize(
    ("data", "word"),
    [
        ([], "keyframes"),
        ({"keyframes": []}, "at least one"),
        ({"keyframes": [3]}, "keyframe 0"),
        ({"keyframes": [START], "speed": 2}, "speed"),
        ({"keyframes": [START], "fps": 0}, "fps"),
        ({"keyframes": [{**START, "eye": 1}]}, "eye"),
        ({"keyframes": [{**START, "time": 0}]}, "either"),
        ({"keyframes": [{**START, "origin": [0, 0]}]}, "three numbers"),
        ({"keyframes": [{**START, "origin": [0, 0, "x"]}]}, "finite"),
        ({"keyframes": [{**START, "target": [0, 0, 0]}]}, "along up"),
        ({"keyframes": [{**START, "target": [0, 1, 0]}]}, "along up"),
        ({"keyframes": [{**START, "fov": 180}]}, "fov"),
        ({"keyframes": [START, START]}, "increase"),
        ({"keyframes": [{**START, "frame": -1}]}, "negative"),
        ({"keyframes": [START, {k: v for k, v in END.items() if k != "fov"}]}, "all keyframes"),
    ],
)
def test_wrong_keyframes_are_refused(data, word):
    with pytest.raises(UsageError, match=word):
        camera_path.from_data(data)
