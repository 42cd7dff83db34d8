"""What an edit of the scene has moved, and how to look back at the scene before it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy.spatial.transform import Rotation

from ..integrators.change import Change
from ..paths.moves import Moves
from ..transforms import TO_WORLD, Matrix, is_rigid
from .edits import Parameters, differences, put, snapshot

_LOOKS = ("silhouette_sampling_weight", "vertex_normals", "vertex_texcoords")
"""Parameters of shapes that say nothing of where their points are; attributes, too."""

_SAMPLED = 512
"""Vertices of a mesh that its motion is found from."""

_RIGID = 1e-5
"""How far a vertex may be from where a rigid motion puts it, relative to the coordinates' size."""


class Watched:
    """A scene whose edits between frames are followed.

    Parameters
    ----------
    scene : Scene
    """

    def __init__(self, scene: mi.Scene) -> None:
        self._parameters = mi.traverse(scene)
        shapes = [node for node in self._parameters.hierarchy if isinstance(node, mi.Shape)]
        self._numbers = {shape: _number(shape) for shape in shapes}
        outside = set(scene.shapes())
        self._grouped = {shape for shape in shapes if shape not in outside}
        self._instances = [shape for shape in shapes if shape.class_name() == "Instance"]
        self._before = snapshot(self._parameters)

    def change(self) -> Change:
        """What has been edited since the last call."""
        before, after = self._before, snapshot(self._parameters)
        self._before = after
        names = [name for name in differences(before, after) if name in before]
        old, new = ({name: values[name] for name in names} for values in (before, after))
        return Change(self._moves(old, new), lambda: _undone(self._parameters, old, new))

    def _moves(self, old: Mapping[str, Any], new: Mapping[str, Any]) -> Moves:
        """How the shapes have moved."""
        size = max(self._numbers.values(), default=0) + 1
        quaternions, offsets = np.zeros((4, size)), np.zeros((3, size))
        moved, lost = np.zeros(size, np.uint32), np.zeros(size, np.uint32)
        for name in new:
            node = self._parameters.properties[name][2]
            kind = name.rpartition(".")[2]
            if not isinstance(node, mi.Shape) or _only_looks(kind):
                continue
            motion = _motion(kind, old[name], new[name])
            if node in self._grouped:
                # Which shape of its group an instance shows is not stored with a vertex.
                places = [self._numbers[instance] for instance in self._instances]
                motion = None
            else:
                places = [self._numbers[node]]
            moved[places] = 1
            if motion is None:
                lost[places] = 1
                continue
            rotation = Rotation.from_matrix(motion[:3, :3])
            quaternions[:, places] = rotation.as_quat()[:, None]
            offsets[:, places] = motion[:3, 3:]
        moves = Moves(
            mi.Vector3f(*(row.tolist() for row in quaternions[:3])),
            mi.Float(quaternions[3].tolist()),
            mi.Vector3f(*(row.tolist() for row in offsets)),
            mi.UInt32(moved.tolist()),
            mi.UInt32(lost.tolist()),
            mi.UInt32(size),
        )
        dr.make_opaque(moves)
        return moves


def _number(shape: mi.Shape) -> int:
    return int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0])


def _only_looks(kind: str) -> bool:
    attribute = kind.startswith(("vertex_", "face_")) and kind != "vertex_positions"
    return attribute or kind in _LOOKS


def _motion(kind: str, old: Any, new: Any) -> Matrix | None:
    """The rigid motion that an edit is, (4, 4); None where it is none."""
    if kind == TO_WORLD:
        first, second = (np.array(t.matrix, dtype=np.float64).reshape(4, 4) for t in (old, new))
        motion = second @ np.linalg.inv(first)
        return motion if is_rigid(motion) else None
    if kind == "vertex_positions" and dr.width(old) == dr.width(new):
        return _fitted(*(np.array(v, dtype=np.float64).reshape(-1, 3) for v in (old, new)))
    return None


def _fitted(old: Matrix, new: Matrix) -> Matrix | None:
    """The rigid motion that takes one set of points to another; None if there is none."""
    some = np.linspace(0, len(old) - 1, min(len(old), _SAMPLED)).astype(int)
    centres = old[some].mean(axis=0), new[some].mean(axis=0)
    rotation = np.eye(3)
    spread = old[some] - centres[0]
    if np.ptp(spread) > 0:
        u, _, v = np.linalg.svd(spread.T @ (new[some] - centres[1]))
        sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
        rotation = (u @ sign @ v).T
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = rotation, centres[1] - rotation @ centres[0]
    left = np.abs(old @ rotation.T + motion[:3, 3] - new).max()
    return motion if left <= _RIGID * max(np.abs(old).max(), np.abs(new).max()) else None


@contextmanager
def _undone(
    parameters: Parameters, old: Mapping[str, Any], new: Mapping[str, Any]
) -> Iterator[None]:
    put(parameters, old)
    try:
        yield
    finally:
        put(parameters, new)
