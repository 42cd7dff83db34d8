"""What moves or jumps during a run: the camera, or a light, to where the reference has it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...errors import UsageError
from ...transforms import TO_WORLD, look_at, matrix_of, set_matrix, transform_names
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
        movers.append(_mover(mi.traverse(sensor), TO_WORLD, motion.step))
    if motion.light:
        parameters = mi.traverse(scene)
        # Vertices of meshes are left out: moved back, their normals would not be what they were.
        known = transform_names(parameters)
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


def _cut(parameters: Any, before: View, measured: int) -> Place:
    here = matrix_of(parameters), float(np.ravel(parameters["x_fov"])[0])
    there = look_at(before.origin, before.target, before.up), before.fov

    def place(frames: int) -> None:
        matrix, fov = here if frames < measured else there
        set_matrix(parameters, TO_WORLD, matrix)
        parameters["x_fov"] = fov
        dr.make_opaque(parameters["x_fov"])
        parameters.update()

    return place


def _mover(parameters: Any, name: str, step: tuple[float, float, float]) -> Place:
    end = matrix_of(parameters, name)

    def move(frames: int) -> None:
        matrix = end.copy()
        matrix[:3, 3] -= frames * np.array(step)
        # The variants of a study share one scene, and only the first to come moves it.
        if np.allclose(matrix, matrix_of(parameters, name), rtol=0.0, atol=1e-6):
            return
        set_matrix(parameters, name, matrix)
        parameters.update()

    return move
