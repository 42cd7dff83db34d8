"""Edits of every parameter that a plugin exposes, and whether a frame after them is what it should.

A renderer that has followed the edits is compared with one that has seen the edited scene alone and
records nothing.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import zoo

SIZE = 12

UNEDITED = ("silhouette_sampling_weight", "control_point_count", "use_pigmentation")
"""A weight of differentiable rendering, a number that other parameters determine, and a switch to
a parameter that is not there (Mitsuba 3.9 crashes)."""


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


def thing_parameters(scene: mi.Scene, parameters: mi.SceneParameters) -> list[str]:
    """Keys of the parameters of ``thing`` that can be edited."""
    return [
        key
        for key in parameters.keys()
        if key.split(".")[0] == "thing"
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
        array = np.roll(array, 3 * step)[3 * step :]
    elif name == "segment_indices":
        array = array[step:]
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


def stale_edits(description: dict[str, Any], steps: int, keys: Any = None) -> dict[str, list[int]]:
    """For every parameter of ``thing`` the steps after which ``reset`` left something stale."""
    scene = mi.load_dict(description)
    renderer = mi.load_dict(RENDERER)
    frames(renderer, scene)
    result: dict[str, list[int]] = {}
    for key in keys or thing_parameters(scene, mi.traverse(scene)):
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
        if key.split(".")[-1] in ("faces", "segment_indices"):
            parameters[key] = start
            parameters.update()
    return result
