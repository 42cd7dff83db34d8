"""Edits of every parameter that a plugin exposes, and whether a frame after them is what it should.

A renderer that has followed the edits is compared with one that has seen the edited scene alone and
records nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import zoo

SIZE = 12

UNEDITED = {
    "silhouette_sampling_weight": "of differentiable rendering alone",
    "control_point_count": "follows from the control points",
    "segment_indices": "Mitsuba 3.9 leaves Embree with the old ones, in memory that is freed",
    "use_pigmentation": "switches hair to a colour that it does not have; Mitsuba 3.9 crashes",
}


def scene_with(plugin: dict[str, Any], **others: dict[str, Any]) -> dict[str, Any]:
    """The plugin ``thing`` over a floor, below a lamp and a sky."""
    transform = mi.ScalarTransform4f
    return {
        "type": "scene",
        "sensor": zoo._sensor(SIZE, SIZE, 45.0, [0, 2.2, 3.2], [0, 0.2, 0]),
        "sky": {"type": "constant", "radiance": 0.3},
        "lamp": {
            "type": "rectangle",
            "to_world": transform().look_at([2.5, 6, -2], [0, 0, 0], [0, 1, 0]).scale([2, 2, 1]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [3.0, 2.7, 2.2]}},
        },
        "floor": {
            "type": "rectangle",
            "to_world": transform().translate([0, -1.1, 0]).rotate([1, 0, 0], -90).scale(3),
        },
        **others,
        "thing": plugin,
    }


def things() -> dict[str, dict[str, Any]]:
    """A scene for every plugin of this Mitsuba that has parameters."""
    transform = mi.ScalarTransform4f
    box = {"type": "cube", "to_world": transform().scale(0.5)}
    scenes = {f"bsdf {name}": scene_with(_ball(bsdf)) for name, bsdf in zoo.bsdfs().items()}
    scenes |= {
        f"texture {name}": scene_with(_ball({"type": "diffuse", "reflectance": texture}))
        for name, texture in _textures().items()
    }
    scenes["texture mesh_attribute"] = scene_with(_colored_mesh())
    scenes |= {
        f"shape {name}": scene_with(shape)
        for name, shape in zoo.shapes().items()
        if shape["type"] != "instance"
    }
    scenes["shape instance"] = scene_with(
        {"type": "instance", "group": {"type": "ref", "id": "group"}},
        group={"type": "shapegroup", "box": box},
    )
    scenes["shape shapegroup"] = scene_with(
        {"type": "shapegroup", "box": box, "ball": {"type": "sphere"}},
        instance={"type": "instance", "group": {"type": "ref", "id": "thing"}},
    )
    scenes |= {
        f"emitter {name}": scene_with(emitter)
        for name, emitter in zoo.emitters().items()
        if name != "none"
    }
    for name, sky in skies().items():
        scenes[f"emitter {name}"] = scene_with(sky)
        del scenes[f"emitter {name}"]["sky"]
    for name in ("perspective", "thinlens", "orthographic"):
        sensor = zoo._sensor(SIZE, SIZE, 45.0, [0, 2.2, 3.2], [0, 0.2, 0]) | {"type": name}
        if name == "thinlens":
            sensor |= {"aperture_radius": 0.1, "focus_distance": 3.0}
        if name == "orthographic":
            del sensor["fov"], sensor["fov_axis"]
        scenes[f"sensor {name}"] = scene_with(sensor)
        del scenes[f"sensor {name}"]["sensor"]
    return scenes


def _ball(bsdf: dict[str, Any]) -> dict[str, Any]:
    return {"type": "sphere", "bsdf": bsdf}


def _textures() -> dict[str, dict[str, Any]]:
    texels = np.random.default_rng(7).random((4, 4, 3)).astype(np.float32)
    return {
        "bitmap": {"type": "bitmap", "bitmap": mi.Bitmap(texels)},
        "bitmap_8_bits": {
            "type": "bitmap",
            "bitmap": mi.Bitmap((255 * texels).astype(np.uint8)),
            "format": "auto",
        },
        "volume": {
            "type": "volume",
            "volume": {"type": "gridvolume", "grid": mi.VolumeGrid(texels[None])},
        },
        "uniform": {"type": "uniform", "value": 0.6},
        "srgb": {"type": "rgb", "value": [0.2, 0.5, 0.7]},
        "rawconstant": {"type": "rawconstant", "value": 0.5},
    }


def _colored_mesh() -> mi.Mesh:
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(
        {
            "type": "diffuse",
            "reflectance": {"type": "mesh_attribute", "name": "vertex_color"},
        }
    )
    mesh = mi.Mesh("thing", 3, 1, props=properties)
    mesh.add_attribute("vertex_color", 3, [0.2, 0.5, 0.7] * 3)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.float32([-1, -0.5, 0, 1, -0.5, 0, 0, 1, 0])
    parameters["faces"] = np.uint32([0, 1, 2])
    parameters.update()
    mesh.set_id("thing")
    return mesh


def skies() -> dict[str, dict[str, Any]]:
    return {
        "envmap": zoo.envmap_scene()["sky"],
        "sunsky": zoo.sunsky_scene()["sky"],
        "constant": {"type": "constant", "radiance": 0.4},
        "directional": {"type": "directional", "direction": [0.3, -1, -0.4], "irradiance": 1.0},
    }


def thing_parameters(parameters: mi.SceneParameters) -> list[str]:
    """Keys of the parameters of ``thing`` that can be edited."""
    return [key for key in editable(parameters) if key.split(".")[0] == "thing"]


def editable(parameters: mi.SceneParameters) -> list[str]:
    """Keys of all parameters that can be edited, but for those of films."""
    return [
        key
        for key in parameters.keys()
        if ".film." not in key
        and key.split(".")[-1] not in UNEDITED
        and not parameters.flags(key) & mi.ParamFlags.ReadOnly
        and parameters.properties[key][0] is not None
        and _size(parameters[key]) > 0
    ]


def _size(value: Any) -> int:
    return 1 if isinstance(value, int | float) else dr.width(value)


def edited(name: str, value: Any, step: int) -> Any:
    """A new value of a parameter, further from ``value`` with every step.

    Arrays come from NumPy every other time: Dr.Jit uses that memory as it is.
    """
    if isinstance(value, bool):
        return value ^ bool(step % 2)
    if isinstance(value, int | float):
        return type(value)(value * (1 - 0.05 * step) if value else 0.02 * step)
    if hasattr(value, "inverse_transpose"):
        return _moved(value, step)
    array = np.array(value)
    if name == "faces":
        array = np.roll(array, 3 * step)[: max(3, array.size - 3 * step)]
    elif np.issubdtype(array.dtype, np.floating):
        array = array * np.asarray(1 - 0.05 * step, array.dtype)
    else:
        array = array // (1 + step % 3)
    result = type(value)(array)
    return result if step % 2 else _owned(result)


def _owned(value: Any) -> Any:
    """The same numbers in memory of Dr.Jit."""
    result = value + type(value)(0)
    dr.eval(result)
    return result


def _moved(transform: Any, step: int) -> Any:
    if type(transform).__name__.endswith("3f"):
        return type(transform)().scale(1 + 0.1 * step) @ transform
    return type(transform)().translate([0.04 * step, 0.02 * step, 0]) @ transform


def frames(renderer: mi.Integrator, scene: mi.Scene, count: int = 2) -> np.ndarray:
    return np.stack([np.array(renderer.render(scene, seed=i, spp=1)) for i in range(count)])


def untouched(parameters: dict[str, Any], scene: mi.Scene) -> np.ndarray:
    """What a new integrator shows that records nothing."""
    with dr.scoped_set_flag(dr.JitFlag.KernelFreezing, False):
        return frames(mi.load_dict(parameters), scene)


RENDERER = {"type": "restir_pt", "max_depth": 4, "spatial_neighbors": 1}


def stale_edits(
    description: dict[str, Any], steps: int, keys: Sequence[str] = ()
) -> dict[str, list[int]]:
    """For every parameter of ``thing`` (or those named) the steps that left something old."""
    scene = mi.load_dict(description)
    renderer = mi.load_dict(RENDERER)
    frames(renderer, scene)
    result: dict[str, list[int]] = {}
    for key in keys or thing_parameters(mi.traverse(scene)):
        parameters = mi.traverse(scene)
        start = parameters[key]
        start = start if isinstance(start, int | float) else type(start)(start)
        result[key] = []
        for step in range(1, steps + 1):
            parameters[key] = edited(key.split(".")[-1], start, step)
            parameters.update()
            renderer.reset()
            shown = frames(renderer, scene)
            if not np.array_equal(shown, untouched(RENDERER, scene), equal_nan=True):
                result[key].append(step)
    return result
