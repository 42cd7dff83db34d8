"""Notices edits of a scene between frames, which a recorded frame would not see.

Dr.Jit 1.5 replays a recording with the scene's variables of the moment, but not with all that a
scene consists of. Numbers that are no Dr.Jit variables (``scale`` of a bump map, ``eta`` of a
plastic) become constants of the kernels, and so do the addresses of memory that Dr.Jit does not own
(an array that was assigned from NumPy): later frames would read old numbers, or freed memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..transforms import TO_WORLD

RESHAPING = ("faces", "segment_indices", "grid")
"""Parameters of shapes that say what a primitive is."""

LIGHTS = ("AreaLight", "PointLight", "ConstantBackgroundEmitter")
"""Emitters whose colour recordings follow."""

_FIXED = ("vertex_positions", "vertex_normals", "vertex_texcoords")
"""Parameters of meshes whose names begin like those of attributes."""


@dataclass(frozen=True)
class Edit:
    """An edit of the scene.

    Attributes
    ----------
    reshaped : tuple of Shape
        Shapes whose primitives are not what they were, those in shape groups included.
    replayable : bool
        Whether recordings follow it: lights have other colours, or what has a transform is
        elsewhere, and that is all.
    """

    reshaped: tuple[mi.Shape, ...]
    replayable: bool


@dataclass(frozen=True)
class Parameter:
    """A parameter that a node of the scene exposes, and where its value is."""

    node: mi.Object
    name: str
    pointer: Any
    kind: Any

    def read(self) -> Any:
        """The value: a number, or a reference that follows later edits."""
        if self.kind is None:
            return self.pointer
        return mi.get_property(self.pointer, self.kind, self.node)


class SceneWatch:
    """Remembers what a scene consists of, and says when that has changed.

    Parameters
    ----------
    scene : Scene
    """

    def __init__(self, scene: mi.Scene) -> None:
        self._scene = scene
        self._known = _Contents(scene)

    def look(self, thorough: bool) -> Edit | None:
        """What has been edited since the last look; None if nothing.

        Parameters
        ----------
        thorough : bool
            Notice objects that were added, too. It takes about 10 µs a parameter.
        """
        known = self._known
        added = thorough and _structure(*_exposed(self._scene)[:2]) != known.structure
        if not (added or known.changed()):
            return None
        self._known = _Contents(self._scene)
        return Edit(
            tuple(
                shape
                for shape, primitives in self._known.primitives.items()
                if known.primitives.get(shape) != primitives
            ),
            self._known.differs_in_followed(known),
        )


class _Contents:
    """The nodes and parameters of a scene that recordings read, and their state when it was made.

    Variables are compared by their indices, which take next to no time to read. They are held, so
    that no index can pass to another variable in the meantime.
    """

    def __init__(self, scene: mi.Scene) -> None:
        nodes, parameters, self._parents = _exposed(scene)
        self.structure = _structure(nodes, parameters)
        self._shapes = [node for node in nodes if isinstance(node, mi.Shape)]
        self._meshes = [node for node in self._shapes if isinstance(node, mi.Mesh)]
        self._buffers = [p for p in parameters if _is_mesh_attribute(p)]
        # What is written in Python has attributes that it need not expose.
        self._python = [vars(node) for node in nodes if hasattr(node, "__dict__")]

        self._variables: list[Any] = []
        self._followed: list[bool] = []
        self._numbers: list[Parameter] = []
        self._records: list[tuple[Any, Any]] = []
        meaning: dict[mi.Shape, list[int]] = {shape: [] for shape in self._shapes}
        for parameter in parameters:
            if _is_mesh_attribute(parameter):
                continue
            value = parameter.read()
            if indices := dr.detail.collect_indices(value):
                self._variables.append(_witness(value))
                self._followed.append(_is_followed(parameter, self._parents))
                if parameter.name in RESHAPING and parameter.node in meaning:
                    meaning[parameter.node] += indices
            elif isinstance(value, (bool, int, float, str)):
                self._numbers.append(parameter)
            else:
                self._records.append((value, type(value)(value)))
        self.primitives = {
            shape: (shape.primitive_count(), indices) for shape, indices in meaning.items()
        }
        self._held = dr.copy([self._variables, self._loose_variables()])
        self._state = self._read()

    def changed(self) -> bool:
        """Whether the scene has another state by now."""
        return self._read() != self._state or not all(
            dr.all(value == copy, axis=None) for value, copy in self._records
        )

    def differs_in_followed(self, other: _Contents) -> bool:
        """Whether nothing differs from ``other`` but what recordings follow."""
        copies = zip(self._records, other._records, strict=False)
        return (
            self.structure == other.structure
            and self._state[1:] == other._state[1:]
            and all(dr.all(mine == theirs, axis=None) for (_, mine), (_, theirs) in copies)
            and all(
                followed or dr.detail.collect_indices(mine) == dr.detail.collect_indices(theirs)
                for mine, theirs, followed in zip(
                    self._held[0], other._held[0], self._followed, strict=True
                )
            )
        )

    def _read(self) -> list[Any]:
        return [
            dr.detail.collect_indices(self._variables),
            dr.detail.collect_indices(self._loose_variables()),
            [parameter.read() for parameter in self._numbers],
            [mesh.has_mesh_attributes() for mesh in self._meshes],
            [shape.bsdf() for shape in self._shapes],
            [
                value
                for attributes in self._python
                for value in attributes.values()
                if isinstance(value, (bool, int, float, str))
            ],
        ]

    def _loose_variables(self) -> list[Any]:
        """Variables that cannot be referred to, because they move in memory."""
        buffers = [p.node.attribute_buffer(p.name) for p in self._buffers if _exists(p)]
        return buffers + [
            value
            for attributes in self._python
            for value in attributes.values()
            if dr.is_array_v(value)
        ]


def _exposed(
    scene: mi.Scene,
) -> tuple[list[mi.Object], list[Parameter], dict[mi.Object, mi.Object | None]]:
    """The nodes of a scene, their parameters, and each node's parent.

    Sensors are left out: no recording reads them.
    """
    exposed = mi.traverse(scene)
    outside = (mi.Sensor, mi.Integrator)
    inside: dict[mi.Object, bool] = {}
    for node, (parent, _) in exposed.hierarchy.items():
        inside[node] = not isinstance(node, outside) and (parent is None or inside[parent])
    parameters = [
        Parameter(node, key.rsplit(".", 1)[-1], pointer, kind)
        for key, (pointer, kind, node, _) in exposed.properties.items()
        if inside[node] and pointer is not None
    ]
    parents = {node: parent for node, (parent, _) in exposed.hierarchy.items()}
    return [node for node in inside if inside[node]], parameters, parents


def _structure(nodes: list[mi.Object], parameters: list[Parameter]) -> list[Any]:
    """What there is in a scene, whatever its values."""
    return [*nodes, *((parameter.node, parameter.name) for parameter in parameters)]


def _is_followed(parameter: Parameter, parents: dict[mi.Object, mi.Object | None]) -> bool:
    """Whether it is a colour of a light, or a place, that Mitsuba keeps in variables alone.

    The vertices of a mesh are not: they may have been assigned from NumPy.
    """
    if parameter.name == TO_WORLD:
        places = isinstance(parameter.node, (mi.Shape, mi.Emitter))
        return places and not hasattr(parameter.node, "__dict__")
    if parameter.name == "position":
        return parameter.node.class_name() == "PointLight"
    light = parents.get(parameter.node)
    return parameter.name == "value" and light is not None and light.class_name() in LIGHTS


def _is_mesh_attribute(parameter: Parameter) -> bool:
    """Whether it is an attribute, which a mesh moves in memory when it gets another one."""
    return (
        isinstance(parameter.node, mi.Mesh)
        and parameter.name.startswith(("vertex_", "face_"))
        and parameter.name not in _FIXED
    )


def _exists(attribute: Parameter) -> bool:
    try:
        attribute.node.attribute_buffer(attribute.name)
    except RuntimeError:
        return False
    return True


def _witness(value: Any) -> Any:
    """What tells that a variable was replaced: itself, of a transform one entry of the inverse.

    A transform has 32 entries, and Mitsuba computes the inverse anew at every update.
    """
    return value.inverse_transpose[0][0] if hasattr(value, "inverse_transpose") else value
