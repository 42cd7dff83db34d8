"""Small scenes that all modes render: a room, its variations, and surfaces near the thresholds."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

SIZE = 32

Scene = dict[str, Any]

CAMERA = ([0.0, 1.0, 3.4], [0.0, 0.9, 0.0])


def look(origin: Any, target: Any) -> Any:
    return mi.ScalarTransform4f().look_at(origin, target, [0, 1, 0])


def sensor(lens: bool = False, fov: float = 40.0) -> Scene:
    result: Scene = {
        "type": "perspective",
        "fov": fov,
        "to_world": look(*CAMERA),
        "film": {
            "type": "hdrfilm",
            "width": SIZE,
            "height": SIZE,
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent", "sample_count": 1},
    }
    if lens:
        result.update(type="thinlens", aperture_radius=0.08, focus_distance=3.4)
    return result


def large_sensor() -> mi.Sensor:
    """The same with 128x128 pixels: enough that several threads share a kernel."""
    description = sensor()
    description["film"] |= {"width": 128, "height": 128}
    return mi.load_dict(description)


def _rgb(*value: float) -> Scene:
    return {"type": "rgb", "value": list(value)}


def _diffuse(*value: float) -> Scene:
    return {"type": "twosided", "nested": {"type": "diffuse", "reflectance": _rgb(*value)}}


def _walls(floor: Scene) -> Scene:
    """Five walls of a room of 2 x 2 x 2, open to the camera."""
    transform = mi.ScalarTransform4f

    def wall(place: Any, bsdf: Scene) -> Scene:
        return {"type": "rectangle", "to_world": place, "bsdf": bsdf}

    up, side = [1, 0, 0], [0, 1, 0]
    white = _diffuse(0.7, 0.7, 0.7)
    return {
        "floor": wall(transform().rotate(up, -90), floor),
        "ceiling": wall(transform().translate([0, 2, 0]).rotate(up, 90), white),
        "back": wall(transform().translate([0, 1, -1]), white),
        "left": wall(transform().translate([-1, 1, 0]).rotate(side, 90), _diffuse(0.7, 0.2, 0.15)),
        "right": wall(transform().translate([1, 1, 0]).rotate(side, -90), _diffuse(0.2, 0.6, 0.2)),
    }


def room(lens: bool = False, light_in_view: bool = False) -> Scene:
    """A box with a glossy floor, a rough metal box, a plastic ball, an area light and a lamp.

    The area light is above the view: the noise of its visible edges would drown everything else.
    """
    transform = mi.ScalarTransform4f
    light = [0.2, 1.7, 0] if light_in_view else [0.2, 1.95, 1.1]
    plastic = {
        "type": "twosided",
        "nested": {"type": "roughplastic", "diffuse_reflectance": 0.3, "alpha": 0.2},
    }
    return {
        "type": "scene",
        "sensor": sensor(lens),
        **_walls(plastic),
        "light": {
            "type": "rectangle",
            "to_world": transform().translate(light).rotate([1, 0, 0], 90).scale([0.6, 0.3, 1]),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": _rgb(6.0, 5.0, 3.5)},
        },
        "lamp": {
            "type": "point",
            "position": [-0.5, 0.5, 0.7],
            "intensity": _rgb(0.2, 0.3, 0.4),
        },
        "metal": {
            "type": "cube",
            "to_world": transform()
            .translate([-0.4, 0.6, -0.4])
            .rotate([0, 1, 0], 20)
            .scale([0.25, 0.6, 0.25]),
            "bsdf": {"type": "roughconductor", "material": "Al", "alpha": 0.2},
        },
        "ball": {
            "type": "sphere",
            "center": [0.45, 0.35, 0.2],
            "radius": 0.35,
            "bsdf": {"type": "plastic", "diffuse_reflectance": _rgb(0.3, 0.4, 0.6)},
        },
    }


def furniture() -> Scene:
    """The room with an instance, a disk and a cylinder, lit by a mesh and a ball."""
    transform = mi.ScalarTransform4f
    glossy = {"type": "roughconductor", "material": "Al", "alpha": 0.25}
    scene = {
        "type": "scene",
        "sensor": sensor(),
        **_walls(_diffuse(0.6, 0.6, 0.6)),
        "bulb": {
            "type": "cube",
            "to_world": transform().translate([0.3, 1.6, 0.9]).scale(0.15),
            "emitter": {"type": "area", "radiance": _rgb(12.0, 10.0, 7.0)},
        },
        "moon": {
            "type": "sphere",
            "center": [-0.6, 1.5, 1.2],
            "radius": 0.2,
            "emitter": {"type": "area", "radiance": _rgb(3.0, 5.0, 8.0)},
        },
        "group": {"type": "shapegroup", "inner": {"type": "cube", "bsdf": glossy}},
        "copy": {
            "type": "instance",
            "group": {"type": "ref", "id": "group"},
            "to_world": transform().translate([-0.4, 0.4, -0.3]).scale([0.25, 0.4, 0.25]),
        },
        "plate": {
            "type": "disk",
            "to_world": transform().translate([0.5, 1.0, -0.4]).scale(0.4),
            "bsdf": {"type": "twosided", "nested": glossy},
        },
        "pillar": {
            "type": "cylinder",
            "p0": [0.4, 0.0, 0.2],
            "p1": [0.4, 0.6, 0.2],
            "radius": 0.15,
            "bsdf": _diffuse(0.3, 0.5, 0.6),
        },
    }
    return scene


def open_room(distance: float = CAMERA[0][2]) -> Scene:
    """The room with a point light alone, and nothing that casts a shadow.

    From far away the pixel's footprint is of the size of the room: few pairs of vertices may be
    reconnected, and which do depends on the pixel.
    """
    view = sensor(fov=float(2 * np.degrees(np.arctan(1.0 / (distance - 1.0)))))
    view["to_world"] = look(
        [0.3 * distance / 3.4, 1.0 + 0.3 * distance / 3.4, distance], [0, 0.9, 0]
    )
    return {
        "type": "scene",
        "sensor": view,
        **_walls({"type": "twosided", "nested": {"type": "roughconductor", "alpha": 0.3}}),
        "lamp": {"type": "point", "position": [0.3, 1.3, 0.2], "intensity": _rgb(2.0, 1.5, 1.0)},
    }


def grooves(alpha: float = 0.2, period: float = 0.16) -> Scene:
    """A sheet of V-shaped grooves of rough metal: vertices close together, pdfs near the limit.

    The light's paths are two and more glossy bounces long, and their connectability differs from
    pixel to pixel: what forgets a part of the invertibility checks is wrong here.
    """
    transform = mi.ScalarTransform4f
    metal = {
        "type": "twosided",
        "nested": {"type": "roughconductor", "material": "Al", "alpha": alpha},
    }
    scene: Scene = {
        "type": "scene",
        "sensor": sensor(fov=22.0),
        "sky": {"type": "constant", "radiance": _rgb(0.2, 0.25, 0.3)},
        "light": {
            "type": "rectangle",
            "to_world": look([1.0, 3.0, 1.5], [0, 0.9, 0]).scale([0.4, 0.4, 1]),
            "emitter": {"type": "area", "radiance": _rgb(12.0, 10.0, 8.0)},
        },
    }
    count = int(1.5 / period) + 1
    for i in range(count):
        y = 0.9 + (i - count / 2) * period
        for side, turn in (("up", 40), ("down", -40)):
            scene[f"{side}_{i}"] = {
                "type": "rectangle",
                "to_world": transform()
                .translate([0, y + (0.25 if side == "up" else -0.25) * period, 0])
                .rotate([1, 0, 0], turn)
                .scale([1.2, 0.25 * period / 0.766, 1]),
                "bsdf": metal,
            }
    return scene


CORNER_CAMERA = ([0.0, 0.6, 0.6], [0.0, 0.08, -0.95])


def corner(scale: float = 1.0, x: float = 0.0) -> Scene:
    """Where floor and back wall of the open room meet, ``scale`` times as large and moved by ``x``.

    Vertices are close together there, and rays start off their surfaces by 9e-5 (1 + max |p|),
    whatever the size of the scene.
    """
    moved = mi.ScalarTransform4f().translate([x, 0, 0]).scale(scale)

    def place(point: Any) -> Any:
        return list(np.array(moved @ mi.ScalarPoint3f(point)))

    view = sensor(fov=18.0)
    view.update(
        to_world=look(*map(place, CORNER_CAMERA)), near_clip=0.01 * scale, far_clip=1e4 * scale
    )
    walls = _walls(_diffuse(0.7, 0.7, 0.7))
    return {
        "type": "scene",
        "sensor": view,
        **{name: {**wall, "to_world": moved @ wall["to_world"]} for name, wall in walls.items()},
        "lamp": {
            "type": "point",
            "position": place([0.3, 1.3, 0.2]),
            "intensity": _rgb(2.0 * scale**2, 1.5 * scale**2, 1.0 * scale**2),
        },
    }
