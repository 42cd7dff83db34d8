"""Every mode converges to the image of Mitsuba's ``path``, on the zoo and on a room."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mitsuba as mi
import pytest
from support import references, rooms
from support.modes import MODES, Mode
from support.runs import assert_unbiased, bias_report, independent_runs, integrator

from mitsuba_restir.sampling.dither import Dither
from mitsuba_restir.sampling.streams import PathName

pytestmark = pytest.mark.usefixtures("one_thread")

# Runs of one test, and the relative error of the image that is found with probability 0.99.
ZOO = {
    "bsdfs": (128, 0.02),
    # One block of it lives on a rare, bright path, which 128 runs may not have.
    "emitters": (768, 0.06),
    "envmap": (128, 0.02),
    "sunsky": (128, 0.03),
    "shapes": (128, 0.02),
    "glossy_shapes": (128, 0.02),
}
ROOM = (256, 0.025)
LIGHT_IN_VIEW = (256, 0.045)  # the edges of the light are noisy, candidates share their position
CHANGING = (256, 0.035)
SPECTRAL = (64, 0.05)  # not recorded, hence slow


def check(
    name: str,
    mode: str | Mode,
    runs: int,
    power: float,
    before_frame: Any = None,
    scene: mi.Scene | None = None,
    label: str = "",
    **parameters: Any,
) -> None:
    case = references.CASES[name]
    chosen = MODES[mode] if isinstance(mode, str) else mode
    scene = scene or case.load()
    renderer = integrator(case.max_depth, chosen, hide_emitters=case.hide_emitters, **parameters)
    report = bias_report(
        independent_runs(renderer, scene, chosen, before_frame), runs, *references.load(name)
    )
    assert_unbiased(report, label or f"{name}-{mode}", power)


@pytest.mark.parametrize("mode", ["candidates_4", "both"])
@pytest.mark.parametrize("name", ZOO)
def test_zoo(rgb, name, mode):
    check(name, mode, *ZOO[name])


@pytest.mark.parametrize("mode", MODES)
def test_room(rgb, mode):
    check("room", mode, *ROOM)


@pytest.mark.parametrize(
    ("name", "mode"), [("room", "both"), ("bsdfs", "candidates_4"), ("emitters", "both")]
)
def test_dithered_seeds(rgb, name, mode):
    """Runs differ in their seed, hence in the offsets of the masks."""
    runs, power = ZOO.get(name, ROOM)
    check(name, mode, runs, power, label=f"{name}-{mode}-dithered", blue_noise_seeds=True)


def test_dithered_seeds_and_ranked_neighbors(rgb):
    parameters = {"blue_noise_seeds": True, "neighbor_sampling": "blue_noise", "mutations": 2}
    check("room", "both", *ROOM, label="room-dithered-ranked", **parameters)


def test_a_fixed_mask_is_seen(rgb, monkeypatch):
    drawn = Dither.stream

    def fixed(self: Dither, name: PathName, x: Any, y: Any) -> Any:
        return drawn(self, replace(name, seed=0 * name.seed), x, y)

    monkeypatch.setattr(Dither, "stream", fixed)
    case, mode = references.CASES["room"], MODES["both"]
    renderer = integrator(case.max_depth, mode, blue_noise_seeds=True)
    runs = independent_runs(renderer, case.load(), mode)
    assert not bias_report(runs, ROOM[0], *references.load("room")).passed


@pytest.mark.parametrize("mode", ["candidates_4", "spatial_1", "both"])
@pytest.mark.parametrize(
    "name", ["room_depth_2", "room_unlimited", "room_visible", "room_hidden", "room_lens"]
)
def test_room_limits(rgb, name, mode):
    check(name, mode, *(LIGHT_IN_VIEW if name in ("room_visible", "room_hidden") else ROOM))


@pytest.mark.parametrize("mode", ["candidates_4", "spatial_3", "temporal", "both", "both_distance"])
def test_grooves(rgb, mode):
    """Vertices close together and roughness near the threshold: invertibility matters."""
    check("grooves", mode, *ROOM)


@pytest.mark.parametrize("mode", ["candidates_4", "both"])
def test_spectral(spectral, mode):
    check("room_spectral", mode, *SPECTRAL)


@pytest.mark.parametrize("mode", ["candidates_4", "both"])
def test_mono(mono, mode):
    check("room_mono", mode, *ROOM)


def moving_camera(scene: mi.Scene, frames: int) -> Any:
    """The camera comes to rest, in the last frame, where the reference's camera is."""
    sensor = scene.sensors()[0]
    parameters = mi.traverse(sensor)
    origin, target = rooms.CAMERA

    def before_frame(t: int) -> None:
        away = frames - 1 - t
        parameters["to_world"] = mi.Transform4f(
            rooms.look(
                [origin[0] + 0.06 * away, origin[1] + 0.03 * away, origin[2] + 0.02 * away],
                [target[0] - 0.02 * away, target[1], target[2]],
            )
        )
        parameters.update()

    return before_frame


@pytest.mark.parametrize("mode", ["temporal", "both"])
@pytest.mark.parametrize("name", ["room", "room_lens", "grooves"])
def test_moving_camera(rgb, name, mode):
    scene = references.CASES[name].load()
    frames = MODES[mode].frames
    check(name, mode, *ROOM, moving_camera(scene, frames), scene)


def edited(scene: mi.Scene, key: str, values: list[Any]) -> Any:
    """Parameter ``key`` has ``values[t]`` in frame t."""
    parameters = mi.traverse(scene)

    def before_frame(t: int) -> None:
        parameters[key] = type(parameters[key])(values[t])
        parameters.update()

    return before_frame


RETRACING = {
    "temporal": Mode({"spatial": False, "retrace_history": True}, frames=3),
    "both": Mode({"spatial_radius": 6.0, "retrace_history": True}, frames=3),
    "both_distance": Mode(
        {
            "spatial_radius": 6.0,
            "retrace_history": True,
            "connectability": "distance_roughness",
        },
        frames=3,
    ),
}


@pytest.mark.parametrize("mode", RETRACING)
def test_light_switches_off(rgb, mode):
    scene = references.CASES["room"].load()
    key = "light.emitter.radiance.value"
    edit = edited(scene, key, [mi.Color3f(6, 5, 3.5), mi.Color3f(6, 5, 3.5), mi.Color3f(0)])
    check("room_lamp_off", RETRACING[mode], *CHANGING, edit, scene, f"off-{mode}")


def test_a_stale_history_is_seen(rgb):
    """The control of the two tests around it: without the retrace, the light's past shines on."""
    case = references.CASES["room_lamp_off"]
    scene = case.load()
    key = "light.emitter.radiance.value"
    edit = edited(scene, key, [mi.Color3f(6, 5, 3.5), mi.Color3f(6, 5, 3.5), mi.Color3f(0)])
    mode = Mode({"spatial": False}, frames=3)
    runs = independent_runs(integrator(case.max_depth, mode), scene, mode, edit)
    assert not bias_report(runs, 64, *references.load("room_lamp_off")).passed


@pytest.mark.parametrize("mode", RETRACING)
def test_light_moves(rgb, mode):
    """Where no surface becomes lit that was dark before; see ``passes/retrace.py`` for the rest."""
    scene = references.CASES["open_room_moved"].load()
    places = [[0.3, 1.3, 0.2], [0.1, 1.2, 0.3], references.LAMP_MOVED]
    edit = edited(scene, "lamp.position", places)
    check("open_room_moved", RETRACING[mode], *CHANGING, edit, scene, f"moved-{mode}")


@pytest.mark.long
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", ["room", "grooves", *ZOO])
def test_long(rgb, name, mode):
    """The same at 16 times the samples."""
    check(name, mode, 2048, 0.02)
