"""Moving objects, lights and cameras: the last frame is what ``path`` shows of the scene then.

The scene comes to rest in its last frame at the place that the reference of ``room`` has. History
of all earlier frames was made in other scenes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from support import mutants, references, rooms
from support.runs import assert_unbiased, bias_report

from mitsuba_restir import sequence
from mitsuba_restir.paths.camera import copy_camera, project
from mitsuba_restir.sequence.change import Watched

pytestmark = pytest.mark.usefixtures("one_thread")

FRAMES = 3
POWER = 0.04
CONTROL_RUNS = 64

OBJECT = [
    {
        "parameter": "metal.to_world",
        "keyframes": [
            {"frame": 0, "translate": [0.3, 0, 0.3], "rotate": {"axis": [0, 1, 0], "angle": 50}},
            {"frame": FRAMES - 1},
        ],
    },
    {
        "parameter": "ball.to_world",
        "keyframes": [{"frame": 0, "translate": [-0.3, 0.5, 0.2]}, {"frame": FRAMES - 1}],
    },
]
LIGHT = [
    {
        "parameter": "light.to_world",
        "keyframes": [{"frame": 0, "translate": [-0.8, -0.3, -1.2]}, {"frame": FRAMES - 1}],
    },
    {
        "parameter": "lamp.position",
        "keyframes": [
            {"frame": 0, "value": [0.6, 1.5, 0.3]},
            {"frame": FRAMES - 1, "value": [-0.5, 0.5, 0.7]},
        ],
    },
]
FURNITURE = [
    {
        "parameter": f"{name}.to_world",
        "keyframes": [{"frame": 0, "translate": move, "rotate": turn}, {"frame": FRAMES - 1}],
    }
    for name, move, turn in (
        ("copy", [0.2, 0.1, 0.3], {"axis": [0, 1, 0.2], "angle": 50}),
        ("plate", [-0.3, 0.1, 0.2], {"axis": [1, 1, 0], "angle": 40}),
        ("pillar", [-0.2, 0.2, 0], {"axis": [0, 0, 1], "angle": 30}),
        ("bulb", [-0.4, -0.2, -0.5], {"axis": [1, 0, 0], "angle": 45}),
        ("moon", [0.3, -0.3, -0.4], {"axis": [0, 1, 0], "angle": 90}),
    )
]
CAMERA = [
    {"frame": 0, "origin": [0.2, 1.1, 3.5], "target": [-0.1, 0.9, 0]},
    {"frame": FRAMES - 1, "origin": rooms.CAMERA[0], "target": rooms.CAMERA[1]},
]
MIXED = {"mutations": 2, "guiding": True, "spatial_radius": 6.0}


def shot(
    tracks: list[Any], room: str = "room", **parameters: Any
) -> Callable[[int], list[np.ndarray]]:
    """Renders the frames of an animation in the room, from a seed."""
    scene = references.CASES[room].load()
    data: dict[str, Any] = {"interpolation": "linear", "tracks": tracks}
    if parameters.pop("camera", False):
        data["keyframes"] = CAMERA
    update = sequence.from_data(data).bind(scene)
    settings = {"max_depth": 5, "retrace_history": True, **parameters}
    integrator = mi.load_dict({"type": "restir_pt", **settings})

    def frames(seed: int) -> list[np.ndarray]:
        integrator.reset()
        film = sequence.Shot(scene, scene.sensors()[0], integrator, update, 1, seed)
        return [film.image(i) for i in range(FRAMES)]

    frames.integrator = integrator
    return frames


def last_frames(frames: Callable[[int], list[np.ndarray]]) -> Iterator[np.ndarray]:
    seed = 0
    while True:
        yield frames(seed)[-1].astype(np.float64)
        seed += 1


CASES = {
    "object": (OBJECT, {"spatial": False}, 64),
    "light": (LIGHT, {"spatial": False}, 128),
    "furniture": (FURNITURE, {"room": "furniture", "spatial": False, "mutations": 1}, 64),
    # Without the mesh: what moves one is traced again in every frame, and takes much longer.
    "all": (OBJECT[1:] + LIGHT, {"camera": True, **MIXED}, 192),
}


def check(name: str, longer: int, power: float) -> Any:
    """Test the last frame of a case, with so many times its runs; returns the integrator."""
    tracks, parameters, runs = CASES[name]
    frames = shot(tracks, **parameters)
    reference = references.load(parameters.get("room", "room"))
    report = bias_report(last_frames(frames), longer * runs, *reference)
    assert_unbiased(report, f"moving-{name}", power)
    return frames.integrator


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_last_frame(rgb, name):
    statistics = check(name, 1, POWER).statistics()
    assert statistics["temporal"]["ok"] > 0.7
    assert statistics["not_finite"] == 0
    if name != "light":
        assert statistics["moving"]["matched"] > 0.5
        assert statistics["moving"]["not_followed"] == 0


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_long(rgb, name):
    """The same at 8 times the samples."""
    check(name, 8, POWER / 2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tracks", "mutant"),
    [
        # The history is followed, but its paths are what they were in the scene before.
        (
            LIGHT,
            mutants.Mutation(
                "suffix = retrace_suffix(scope, there, hit, active)",
                """
    from .suffix import Suffix
    suffix = Suffix(there, mi.Float(1))
""",
            ),
        ),
        # The history's target is that of the scene after the edit: the frame of it is too dark.
        (LIGHT, None),
    ],
    ids=["not evaluated again", "not looked back"],
)
def test_a_wrong_history_is_seen(rgb, monkeypatch, tracks, mutant):
    frames = shot(tracks, spatial=False)
    if mutant is None:
        monkeypatch.setattr(
            Watched, "change", lambda self: replace(changed(self), undone=_as_it_is)
        )
    else:
        mutants.apply(monkeypatch, (mutant,))
    report = bias_report(last_frames(frames), CONTROL_RUNS, *references.load("room"))
    assert not report.passed


changed = Watched.change


def _as_it_is() -> Any:
    from contextlib import nullcontext

    return nullcontext()


# ------------------------------ motion vectors --------------------------------------------------


def instanced() -> dict[str, Any]:
    """A sphere, a mesh and an instance of one, before a wall that stands still."""
    transform = mi.ScalarTransform4f
    return {
        "type": "scene",
        "sensor": rooms.sensor(),
        "sky": {"type": "constant"},
        "wall": {"type": "rectangle", "to_world": transform().translate([0, 1, -1]).scale(2)},
        "ball": {"type": "sphere", "center": [-0.6, 0.9, 0], "radius": 0.35},
        "box": {
            "type": "cube",
            "to_world": transform().translate([0.1, 0.9, 0]).scale(0.25),
        },
        "group": {"type": "shapegroup", "inner": {"type": "cube"}},
        "copy": {
            "type": "instance",
            "group": {"type": "ref", "id": "group"},
            "to_world": transform().translate([0.8, 0.9, 0]).scale(0.25),
        },
    }


MOVE = {"translate": [0.1, 0.05, -0.1], "rotate": {"axis": [1, 2, 0.5], "angle": 20}}


def test_motion_vectors(rgb):
    """Against the points themselves, taken along by the transforms and projected before and now."""
    scene = mi.load_dict(instanced())
    still = _places(scene)
    names = ("ball", "box", "copy")
    tracks = [
        {"parameter": f"{name}.to_world", "keyframes": [{"frame": 0}, {"frame": 1, **MOVE}]}
        for name in names
    ]
    data = {"keyframes": CAMERA, "tracks": tracks, "interpolation": "linear"}
    update = sequence.from_data(data).bind(scene)
    sensor = scene.sensors()[0]
    motions = {track.parameter.split(".")[0]: track for track in sequence.from_data(data).tracks}

    frames = sequence.render(scene, 2, update, aovs="motion, position", max_depth=2)
    next(frames)
    before = copy_camera(sensor)
    frame = next(frames)
    now = copy_camera(sensor)
    p = frame.layers["position"].reshape(-1, 3)
    flow = frame.layers["motion"].reshape(-1, 2)
    which = _owners(scene, p)
    for name in (*names, "wall"):
        chosen = which == name
        assert chosen.sum() > 20, name
        then = p[chosen].astype(np.float64)
        if name in motions:
            inverse = np.linalg.inv(motions[name].at(1, still[name]))
            then = then @ inverse[:3, :3].T + inverse[:3, 3]
        wanted = _film(before, then) - _film(now, p[chosen])
        np.testing.assert_allclose(flow[chosen], wanted * rooms.SIZE, atol=2e-3, err_msg=name)
    moving = frame.statistics["moving"]
    assert moving["matched"] > 0.6
    assert moving["not_followed"] == 0


def _places(scene: mi.Scene) -> dict[str, np.ndarray]:
    """What each object turns about."""
    parameters = mi.traverse(scene)
    corners = np.array(parameters["box.vertex_positions"]).reshape(-1, 3)
    places = {
        name: np.array(parameters[f"{name}.to_world"].matrix).reshape(4, 4)[:3, 3]
        for name in ("ball", "copy")
    }
    return {**places, "box": (corners.min(axis=0) + corners.max(axis=0)) / 2}


def _film(camera: Any, p: np.ndarray) -> np.ndarray:
    uv, _ = project(camera, mi.Point3f(np.ascontiguousarray(p.T, np.float32)), mi.Point2f(0.5))
    return np.array(uv).T


def _owners(scene: mi.Scene, p: np.ndarray) -> np.ndarray:
    """Which object each point is on."""
    camera = mi.traverse(scene.sensors()[0])["to_world"].translation()
    points = mi.Point3f(np.ascontiguousarray(p.T, np.float32))
    pi = scene.ray_intersect_preliminary(mi.Ray3f(camera, dr.normalize(points - camera)), False)
    numbers = {shape.id(): mi.ShapePtr(shape) for shape in scene.shapes()}
    names = np.full(len(p), "", dtype=object)
    for name, pointer in numbers.items():
        found = (pi.instance == pointer) if name == "copy" else (pi.shape == pointer)
        names[np.array(found & pi.is_valid())] = name
    return names


def test_what_is_not_rigid_is_not_followed(rgb):
    scene = mi.load_dict(instanced())
    parameters = mi.traverse(scene)
    rest = np.array(parameters["box.vertex_positions"])

    def squeeze(frame: int) -> None:
        parameters["box.vertex_positions"] = mi.Float((rest * (1 - 0.05 * frame)).tolist())
        parameters.update()

    last = list(sequence.render(scene, 3, squeeze, max_depth=2))[-1]
    assert last.statistics["moving"]["share"] > 0.02
    assert last.statistics["moving"]["not_followed"] == 1
    assert last.statistics["moving"]["matched"] == 0


def test_edits_are_taken_back(rgb):
    """The scene that is looked back at is the one before the edit, but for its last bits."""
    scene = mi.load_dict(instanced())
    parameters = mi.traverse(scene)
    watched = Watched(scene)
    path = mi.load_dict({"type": "path", "max_depth": 3})

    def picture() -> np.ndarray:
        return np.array(mi.render(scene, integrator=path, spp=4, seed=1))

    tracks = [
        {"parameter": f"{name}.to_world", "keyframes": [{"frame": 0}, {"frame": 1, **MOVE}]}
        for name in ("ball", "box", "copy")
    ]
    update = sequence.from_data({"tracks": tracks}).bind(scene)
    before = picture()
    update(1)
    parameters["sky.radiance.value"] = 2.0
    parameters.update()
    after = picture()
    with watched.change().undone():
        np.testing.assert_allclose(picture(), before, rtol=1e-5)
    np.testing.assert_allclose(picture(), after, rtol=1e-5)
    assert not np.array_equal(before, after)


def test_nothing_is_compiled_while_objects_move(rgb):
    scene = references.CASES["room"].load()
    update = sequence.from_data({"tracks": OBJECT + LIGHT}).bind(scene)
    seen: set[Any] = set()
    new = []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        for _ in sequence.render(scene, 6, lambda frame: update(frame % FRAMES), max_depth=3):
            kernels = [k for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT]
            new.append(len({k["hash"] for k in kernels} - seen))
            seen |= {k["hash"] for k in kernels}
    assert new[0] > 0
    assert new[2:] == [0] * 4
