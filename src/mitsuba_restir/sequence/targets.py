"""What an animation moves: a sensor, an object with a transform, a mesh, or any other parameter."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..camera_path import CameraPath
from ..errors import UsageError
from ..transforms import (
    TO_WORLD,
    cofactors,
    look_at,
    matrix_of,
    moved_normals,
    moved_points,
    on_device,
    set_matrix,
    transform_names,
)
from .edits import Parameters, put
from .tracks import Motion, Track, Values

POSITIONS, NORMALS = "vertex_positions", "vertex_normals"

Edit = Callable[[int], dict[str, Any]]
"""Frame number -> new values of parameters."""


@dataclass(frozen=True)
class Placement:
    """
    Puts a scene to a frame.

    Fields
    ------
    edits_scene : bool
        Whether anything but sensors changes.
    """

    parameters: Parameters
    edits: Sequence[Edit]
    move_camera: Callable[[int], None] | None
    edits_scene: bool

    def __call__(self, frame: int) -> None:
        """Put everything to where it is in a frame."""
        if self.move_camera is not None:
            self.move_camera(frame)
        values: dict[str, Any] = {}
        for edit in self.edits:
            values |= edit(frame)
        put(self.parameters, values)


def placement(
    scene: mi.Scene, sensor: mi.Sensor, camera: CameraPath | None, tracks: Sequence[Track]
) -> Placement:
    """Find what the tracks name; see :meth:`.animation.Animation.bind`."""
    parameters = mi.traverse(scene)
    edits = [_edit(parameters, track) for track in tracks]
    sensors = [s.id() for s in scene.sensors()]
    edits_scene = any(track.parameter.split(".")[0] not in sensors for track in tracks)
    move = None if camera is None else _camera_mover(sensor, camera)
    return Placement(parameters, edits, move, edits_scene)


def _edit(parameters: Parameters, track: Track) -> Edit:
    if isinstance(track, Values):
        return _value_edit(parameters, track)
    if track.parameter in parameters:
        return _transform_edit(parameters, track)
    mesh = track.parameter.rpartition(".")[0]
    if f"{mesh}.{POSITIONS}" in parameters:
        return _mesh_edit(parameters, track, mesh)
    meshes = [n.removesuffix(POSITIONS) for n in parameters.keys() if n.endswith(f".{POSITIONS}")]
    known = [*transform_names(parameters), *(f"{mesh}{TO_WORLD}" for mesh in meshes)]
    raise _unknown(track.parameter, known)


def _unknown(name: str, known: Sequence[str]) -> UsageError:
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4) or list(known)[:5]
    return UsageError(
        f"the scene has nothing called '{name}' to animate; there is {', '.join(near) or 'nothing'}"
        + (" ..." if len(known) > len(near) else "")
    )


def _value_edit(parameters: Parameters, track: Values) -> Edit:
    name = track.parameter
    if name not in parameters:
        raise _unknown(name, [n for n in parameters.keys() if not n.endswith(TO_WORLD)])
    kind = type(parameters[name])
    if kind is bool or kind is str or (kind is not float and kind is not int and not _plain(kind)):
        raise UsageError(f"{name} is a {kind.__name__}, which no track can animate")
    size = 1 if kind in (int, float) else np.size(np.array(parameters[name]))
    if track.size not in (1, size):
        raise UsageError(f"{name} needs {size} numbers in a value, not {track.size}")

    def edit(frame: int) -> dict[str, Any]:
        numbers = track.at(frame)
        if kind in (int, float):
            return {name: kind(numbers[0])}
        value = kind(numbers.tolist() if track.size > 1 else [float(numbers[0])] * size)
        dr.make_opaque(value)
        return {name: value}

    return edit


def _plain(kind: Any) -> bool:
    return bool(dr.is_array_v(kind)) and not dr.is_matrix_v(kind) and dr.depth_v(kind) <= 2


def _transform_edit(parameters: Parameters, track: Motion) -> Edit:
    name = track.parameter
    rest = matrix_of(parameters, name)

    def edit(frame: int) -> dict[str, Any]:
        return {name: track.at(frame, rest[:3, 3]) @ rest}

    return edit


def _mesh_edit(parameters: Parameters, track: Motion, mesh: str) -> Edit:
    """Meshes have no transform once they are loaded: their vertices move."""
    rest = mi.Float(parameters[f"{mesh}.{POSITIONS}"])
    normals = mi.Float(parameters[f"{mesh}.{NORMALS}"])
    corners = np.array(rest).reshape(-1, 3)
    origin = (corners.min(axis=0) + corners.max(axis=0)) / 2

    def edit(frame: int) -> dict[str, Any]:
        matrix = track.at(frame, origin.astype(np.float64))
        moved = moved_points(dr.unravel(mi.Point3f, rest), on_device(matrix))
        values = {f"{mesh}.{POSITIONS}": dr.ravel(moved)}
        if dr.width(normals):
            turned = moved_normals(dr.unravel(mi.Normal3f, normals), on_device(cofactors(matrix)))
            values[f"{mesh}.{NORMALS}"] = dr.ravel(turned)
        dr.eval(values)
        return values

    return edit


def _camera_mover(sensor: mi.Sensor, path: CameraPath) -> Callable[[int], None]:
    """What moves the sensor to a frame's pose, in place."""
    parameters = mi.traverse(sensor)
    needed = [TO_WORLD] + (["x_fov"] if path.fovs is not None else [])
    for name in needed:
        if name not in parameters:
            raise UsageError(f"the animation cannot move this sensor: it has no '{name}'")

    def move(frame: int) -> None:
        pose = path.pose(frame)
        view = look_at(pose.origin.tolist(), pose.target.tolist(), pose.up.tolist())
        set_matrix(parameters, TO_WORLD, view)
        if pose.fov is not None:
            parameters["x_fov"] = pose.fov
        parameters.update()

    return move
