"""What moves or jumps during a run: the camera, or a light, to where the reference has it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from ...errors import UsageError
from ..config.study import Study
from ..config.view import View

Place = Callable[[int], None]


def make_place(study: Study, scene: Any, sensor: Any) -> Place | None:
    """
    Make what moves camera and light to where they are so many frames before the last.

    Camera and light are now where the motion ends.

    Raises
    ------
    UsageError
        The scene has no such parameter, or it is no transform.
    """
    motion = study.motion
    if motion is None:
        return None
    if motion.cut_from is not None:
        measured = (study.frames - 1) * study.stride + 1
        return _cut(mi.traverse(sensor), motion.cut_from, measured)
    movers = []
    if any(motion.step):
        movers.append(_mover(mi.traverse(sensor), "to_world", motion.step))
    if motion.light:
        parameters = mi.traverse(scene)
        # Vertices of meshes are left out: moved back, their normals would not be what they were.
        known = [name for name in parameters.keys() if name.endswith(".to_world")]
        if motion.light not in known:
            raise UsageError(
                f"{study.name}: [motion] light = '{motion.light}' is no transform of the scene; "
                f"there are {', '.join(known) or 'none'}"
            )
        movers.append(_mover(parameters, motion.light, motion.light_step))

    def place(frames: int) -> None:
        for move in movers:
            move(frames)

    return place


def look_at(view: View) -> Any:
    """Return a view as the transform of a sensor."""
    vectors = (view.origin, view.target, view.up)
    origin, target, up = map(list, vectors)
    return mi.ScalarTransform4f().look_at(origin=origin, target=target, up=up)


def _cut(parameters: Any, before: View, measured: int) -> Place:
    here = _matrix(parameters["to_world"]), float(np.ravel(parameters["x_fov"])[0])
    there = _matrix(look_at(before)), before.fov

    def place(frames: int) -> None:
        matrix, fov = here if frames < measured else there
        parameters["to_world"] = type(parameters["to_world"])(mi.ScalarTransform4f(matrix).matrix)
        parameters["x_fov"] = fov
        dr.make_opaque(parameters["to_world"], parameters["x_fov"])
        parameters.update()

    return place


def _mover(parameters: Any, name: str, step: tuple[float, float, float]) -> Place:
    end = _matrix(parameters[name])

    def move(frames: int) -> None:
        matrix = end.copy()
        matrix[:3, 3] -= frames * np.array(step)
        # The variants of a study share one scene, and only the first to come moves it.
        if np.allclose(matrix, _matrix(parameters[name]), rtol=0.0, atol=1e-6):
            return
        moved = mi.ScalarTransform4f(matrix)
        parameters[name] = type(parameters[name])(moved.matrix)
        dr.make_opaque(parameters[name])
        parameters.update()

    return move


def _matrix(transform: Any) -> npt.NDArray[np.float64]:
    return np.array(transform.matrix, dtype=np.float64).reshape(4, 4)
