"""The viewer without a browser: what is pure in it, and who is served."""

from __future__ import annotations

import io
import json
import shlex

import numpy as np
import pytest
from PIL import Image

from mitsuba_restir.integrators.parameters import PARAMETERS
from mitsuba_restir.integrators.presets import PRESETS
from mitsuba_restir.viewer import camera, controls, encode, messages, pace, plots, timing
from mitsuba_restir.viewer.camera import Pose
from mitsuba_restir.viewer.command import Subject, command
from mitsuba_restir.viewer.exchange import Published
from mitsuba_restir.viewer.model import Settings, Side, effective, with_parameter
from mitsuba_restir.viewer.pace import Pace
from mitsuba_restir.viewer.reference import Reference
from mitsuba_restir.viewer.session import LEASE, Session

POSE = Pose((1.0, 2.0, 5.0), (0.5, 1.0, 0.0), (0.0, 1.0, 0.0), 50.0)


# ------------------------------ camera ----------------------------------------------------------


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_pose_and_its_matrix_are_the_same_camera(mirrored):
    pose = Pose(POSE.origin, POSE.target, POSE.up, POSE.fov, mirrored)
    matrix = camera.matrix_of(pose)
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(-1.0 if mirrored else 1.0)
    again = camera.pose_of(matrix, pose.distance, pose.fov)
    assert again.mirrored == mirrored
    for name in ("origin", "target", "up"):
        assert getattr(again, name) == pytest.approx(getattr(pose, name))


def test_a_matrix_is_that_of_mitsuba(rgb):
    import mitsuba as mi

    transform = mi.ScalarTransform4f().look_at(POSE.origin, POSE.target, POSE.up)
    assert np.allclose(camera.matrix_of(POSE), np.array(transform.matrix), atol=1e-6)


@pytest.mark.parametrize("mirrored", [False, True])
def test_an_orbit_keeps_target_and_distance_and_follows_the_mouse(mirrored):
    pose = Pose(POSE.origin, POSE.target, POSE.up, POSE.fov, mirrored)
    size = (320, 180)
    front = np.array(pose.target) + 0.2 * np.subtract(pose.origin, pose.target)
    for axis, (dx, dy) in enumerate(((0.02, 0.0), (0.0, 0.02))):
        turned = camera.orbit(pose, dx, dy)
        assert turned.target == pose.target
        assert turned.distance == pytest.approx(pose.distance)
        # What is in front of the target goes where the mouse goes.
        way = camera.project(turned, front, size) - camera.project(pose, front, size)
        assert way[axis] > 10 * abs(way[1 - axis])


def test_a_head_turns_where_the_mouse_goes():
    turned = camera.look(POSE, 0.02, 0.01)
    assert turned.origin == POSE.origin
    seen = camera.project(POSE, np.array(turned.target), (320, 180))
    assert (seen > 0).all()


def test_nothing_turns_over_at_the_top():
    pose = POSE
    for _ in range(50):
        pose = camera.orbit(pose, 0.01, 0.2)
    view = np.subtract(pose.target, pose.origin) / pose.distance
    assert -view[1] == pytest.approx(np.sin(camera.STEEPEST))
    assert np.isfinite(camera.matrix_of(pose)).all()


def test_panning_moves_the_target_with_the_mouse():
    moved = camera.pan(POSE, 0.1, 0.05)
    seen = camera.project(moved, np.array(POSE.target), (320, 180))
    assert (seen > 0).all()


def test_the_wheel_never_reaches_the_target():
    pose = POSE
    for _ in range(100):
        pose = camera.dolly(pose, 1.0)
    assert camera.NEAREST <= pose.distance < 0.01
    assert camera.dolly(POSE, -1.0).distance == pytest.approx(np.e * POSE.distance)


def test_flight_goes_where_the_camera_looks():
    ahead = camera.fly(POSE, 0.0, 0.0, 1.0)
    view = np.subtract(POSE.target, POSE.origin) / POSE.distance
    assert np.subtract(ahead.origin, POSE.origin) == pytest.approx(view)
    aside = camera.fly(POSE, 1.0, 0.0, 0.0)
    # To the right: what was in the middle is to the left now.
    assert camera.project(aside, np.array(POSE.target), (320, 180))[0] < 0


def test_projected_points_are_where_mitsuba_sees_them(rgb):
    import mitsuba as mi

    width, height = 64, 36
    sensor = mi.load_dict(
        {
            "type": "perspective",
            "fov": POSE.fov,
            "to_world": mi.ScalarTransform4f().look_at(POSE.origin, POSE.target, POSE.up),
            "film": {"type": "hdrfilm", "width": width, "height": height},
        }
    )
    place = np.array([[0.2, 0.7], [0.9, 0.1]])
    ray, _ = sensor.sample_ray(0.0, 0.0, mi.Point2f(place.T), mi.Point2f(0.5))
    points = np.array(ray.o + 3.0 * ray.d).T
    expected = (place - 0.5) * [width, height]
    assert camera.project(POSE, points, (width, height)) == pytest.approx(expected, abs=1e-3)
    behind = 2 * np.array(POSE.origin) - points
    assert np.isnan(camera.project(POSE, behind, (width, height))).all()


# ------------------------------ pace ------------------------------------------------------------

SIZES = [pace.size_at((640, 360), level) for level in range(len(pace.SCALES))]


def test_as_many_pixels_as_the_frame_rate_allows():
    slow = pace.measured(Pace(), 640 * 360, 0.2)
    assert pace.chosen(slow, SIZES, 4.0).level == 0
    level = pace.chosen(slow, SIZES, 12.0).level
    width, height = SIZES[level]
    assert slow.cost * width * height <= 1 / 12 < slow.cost * np.prod(SIZES[level - 1])
    assert pace.chosen(slow, SIZES, 1e6).level == len(SIZES) - 1


def test_all_pixels_where_no_rate_is_asked_for_or_nothing_is_known():
    assert pace.chosen(Pace(1.0, 3), SIZES, 0.0).level == 0
    assert pace.chosen(Pace(), SIZES, 60.0).level == 0


def test_levels_do_not_flicker():
    """A cost that wavers by a tenth around a limit changes the level once."""
    limit = 1 / (15.0 * np.prod(SIZES[1]))
    now, levels = Pace(), []
    for frame in range(60):
        now = pace.measured(now, 1, limit * (1.0 + 0.1 * (-1) ** frame))
        now = pace.chosen(now, SIZES, 15.0)
        levels.append(now.level)
    assert np.count_nonzero(np.diff(levels)) <= 1


# ------------------------------ model -----------------------------------------------------------


def test_a_default_is_no_parameter_that_was_set():
    side = with_parameter(Side(), "spatial_neighbors", 5)
    assert dict(side.parameters) == {"spatial_neighbors": 5}
    assert dict(with_parameter(side, "spatial_neighbors", 3).parameters) == {}


def test_a_preset_forgets_what_it_is_about_and_nothing_else():
    side = with_parameter(with_parameter(Side(), "spatial_neighbors", 5), "max_depth", 4)
    chosen = with_parameter(side, "preset", "raw")
    assert dict(chosen.parameters) == {"preset": "raw", "max_depth": 4}
    values = effective(chosen.parameters)
    assert {name: values[name] for name in PRESETS["raw"]} == dict(PRESETS["raw"])
    assert with_parameter(chosen, "guiding", False).parameters["guiding"] is False


@pytest.mark.parametrize(("name", "value"), [("spatial_rounds", 99), ("nothing", 1), ("shift", 3)])
def test_a_value_that_is_not_allowed_is_refused(name, value):
    with pytest.raises(ValueError, match=name):
        with_parameter(Side(), name, value)


# ------------------------------ controls --------------------------------------------------------


def test_every_parameter_has_a_control():
    found = [control.parameter.name for group in controls.grouped().values() for control in group]
    assert sorted(found) == sorted(set(PARAMETERS) - set(controls.HIDDEN))
    assert controls.OTHERS not in controls.grouped()


def test_sliders_go_from_lowest_to_highest_and_back():
    sliders = [
        control
        for group in controls.grouped().values()
        for control in group
        if control.kind == "slider"
    ]
    assert {control.logarithmic for control in sliders} == {True, False}
    for control in sliders:
        low, high, _ = control.positions
        assert control.value(low) == control.parameter.low
        assert control.value(high) == control.parameter.high
        for value in (control.parameter.low, control.parameter.default, control.parameter.high):
            assert control.value(control.position(value)) == pytest.approx(value, rel=0.03)
            control.parameter.check(control.value(control.position(value)))


def test_help_has_no_marks():
    for group in controls.grouped().values():
        for control in group:
            assert not set("`*").intersection(control.help)
            assert ":ref:" not in control.help


# ------------------------------ the command -----------------------------------------------------


def test_the_command_says_all_that_differs():
    side = Side({"preset": "raw", "guiding": False, "mutation_step": 0.1}, spp=2, view="denoised")
    text = command(Subject("a b.xml", "", {"x": "1 2"}, sensor=1, seed=7), side, (64, 36), None)
    words = shlex.split(text)
    assert words[:3] == ["mitsuba-restir", "render", "a b.xml"]
    for pair in (["--resolution", "64x36"], ["--spp", "2"], ["--seed", "7"], ["-s", "1"]):
        assert pair in [words[i : i + 2] for i in range(len(words))]
    assert {"preset=raw", "guiding=false", "mutation_step=0.1", "x=1 2", "--denoise"} < set(words)


def test_a_camera_that_has_moved_goes_into_a_file():
    from mitsuba_restir.camera_path import from_data

    first, second = command(Subject("cornell", ""), Side(), (64, 36), POSE).splitlines()
    _, _, data, _, name = shlex.split(first)
    assert shlex.split(second)[-4:-2] == ["--camera-path", name]
    pose = from_data(json.loads(data)).pose(0)
    assert pose.origin == pytest.approx(POSE.origin)
    assert pose.target == pytest.approx(POSE.target)
    assert pose.fov == POSE.fov


# ------------------------------ plots and pictures ----------------------------------------------


def test_kernels_belong_to_passes():
    values = effective({"mutations": 2, "guiding": True})
    n, table = 100, 64
    kernels = [(1, 0.5), (n, 1.0), (n, 10.0), (n, 5.0), (n, 0.25), (table * 4, 2.0), (1, 0.25)]
    kernels += [(n, 4.0), (n, 3.0), (n, 2.0), (n, 0.5), (16 * n, 0.5)]
    assert timing.by_pass(kernels, n, values, table) == {
        "camera rays": 1.5,
        "candidates": 10.0,
        "temporal reuse": 5.0,
        "learning": 2.5,
        "mutations": 4.0,
        "spatial reuse": 5.0,
        "film": 1.0,
    }


def test_unknown_kernels_are_counted_as_a_whole():
    assert timing.by_pass([(5, 1.0), (7, 2.0)], 100, effective({}), 64) == {"frame": 3.0}


def test_plots_have_both_sides():
    bars = plots.passes([{"candidates": 3.0}, {"candidates": 2.0, "mutations": 1.0}])
    assert bars["yAxis"]["data"] == ["B", "A"]
    data = {series["name"]: series["data"] for series in bars["series"]}
    assert data == {"candidates": [2.0, 3.0], "mutations": [1.0, 0.0]}
    lines = plots.spectra([[(0.1, 2.0)], [(0.1, 0.0), (0.2, 1.0)]])
    assert [series["data"] for series in lines["series"]] == [[[0.1, 2.0]], [[0.2, 1.0]]]
    json.dumps([bars, lines])


def test_a_divided_picture():
    a, b = np.zeros((4, 10, 3), np.uint8), np.full((4, 10, 3), 255, np.uint8)
    both = np.array(Image.open(io.BytesIO(encode.png(encode.split(a, b, 0.3)))))
    assert (both[:, :3] == 0).all()
    assert (both[:, 3:] == 255).all()
    shown = Image.open(io.BytesIO(encode.jpeg(both)))
    assert shown.size == (10, 4)


def test_a_reference_is_of_one_view_and_size():
    reference = Reference(np.ones((4, 8, 3), np.float32), POSE, "x")
    assert reference.fits(POSE, (8, 4))
    assert not reference.fits(POSE, (16, 8))
    assert not reference.fits(camera.dolly(POSE, 0.1), (8, 4))


# ------------------------------ messages and session --------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        '{"type":"drag"}',
        '{"type":"drag","how":"orbit","dx":NaN,"dy":0}',
        '{"type":"drag","how":"orbit","dx":1e9,"dy":0}',
        '{"type":"drag","how":"orbit","dx":"1","dy":0}',
        '{"type":"drag","how":"roll","dx":0.1,"dy":0}',
        '{"type":"seen","number":-1}',
        '{"type":"seen","number":1,"more":2}',
        '{"type":"home","x":"' + "a" * messages.LONGEST + '"}',
        "[" * 3000,
    ],
)
def test_what_is_no_message_is_refused_in_a_line(text):
    with pytest.raises(ValueError, match="message") as error:
        messages.parse(text)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 300


def test_messages():
    assert messages.parse('{"type":"seen","number":3}') == messages.Seen(type="seen", number=3)
    assert messages.parse('{"type":"dolly","amount":1}') == messages.Dolly(type="dolly", amount=1)


def _session() -> Session:
    session = Session(Settings())
    session.start(POSE)
    return session


def test_the_first_to_touch_the_camera_leads(monkeypatch):
    session = _session()
    assert session.leads("a") is None
    assert session.move("a", lambda pose: camera.dolly(pose, 0.1))
    assert session.moved
    assert (session.leads("a"), session.leads("b")) == (True, False)
    assert not session.move("b", lambda pose: camera.dolly(pose, 0.5))
    session.leave(0, "a")
    assert session.go_home("b")
    assert session.pose == POSE
    later = 1e6 + 2 * LEASE
    monkeypatch.setattr("mitsuba_restir.viewer.session.time.monotonic", lambda: later)
    assert session.move("c", lambda pose: pose)


def test_the_worker_rests_where_there_is_nobody_and_nothing_new():
    session = _session()
    assert session.task() is not None
    assert session._due()  # there is no picture yet
    session.pause()
    assert not session._due()  # nor will there be one: the frame has failed
    session.ask("reset")
    assert session.task() is not None
    session.publish(Published(1, (), (), {}))
    assert not session._due()
    key = session.enter(lambda: None)
    assert session._due()
    session.pause()
    assert not session._due()
    session.ask("reset")
    task = session.task()
    assert task is not None
    assert task.resets == 2
    assert session._due()
    session.leave(key, "a")
    assert not session._due()
    session.stop()
    assert session.task() is None


# ------------------------------ what is logged --------------------------------------------------


def test_a_thousand_complaints_are_a_line(capsys):
    import logging

    from mitsuba_restir.viewer.logs import Sparing

    logger = logging.Logger("somebody")
    logger.addHandler(Sparing())
    for _ in range(1000):
        try:
            raise TypeError("two\nlines")
        except TypeError:
            logger.exception("not understood")
    assert capsys.readouterr().err == "viewer: not understood: two lines\n"
