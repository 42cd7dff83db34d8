"""Edits of a scene's parameters: written, compared and taken back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import drjit as dr
import mitsuba as mi
import numpy as np

from ..transforms import set_matrix

Parameters: TypeAlias = Any
"""``mi.SceneParameters``."""

_AFTERWARDS = "vertex_normals"


def put(parameters: Parameters, values: Mapping[str, Any]) -> None:
    """Write parameters of a scene; transforms may be matrices.

    Mitsuba computes the normals of a mesh anew where its positions change, so normals come last.
    """
    normals = {name: v for name, v in values.items() if name.endswith(_AFTERWARDS)}
    for part in ({n: v for n, v in values.items() if n not in normals}, normals):
        for name, value in part.items():
            if isinstance(value, np.ndarray):
                set_matrix(parameters, name, value)
            else:
                parameters[name] = value
        if part:
            parameters.update()


def snapshot(parameters: Parameters) -> dict[str, Any]:
    """The values of all parameters, by name; those of sensors are not part of the scene."""
    values = {}
    for name, (pointer, _, node, _) in parameters.properties.items():
        if pointer is None or isinstance(node, (mi.Sensor, mi.Film, mi.Integrator)):
            continue
        value = parameters[name]
        # A parameter that is read is a reference, which later edits would reach.
        values[name] = type(value)(value) if _is_on_device(value) else value
    return values


def differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Names of the parameters that are not what they were."""
    return [
        name
        for name, value in after.items()
        if name not in before or not _same(before[name], value)
    ]


def _is_on_device(value: Any) -> bool:
    return bool(dr.detail.collect_indices(value))


def _same(one: Any, other: Any) -> bool:
    indices = dr.detail.collect_indices(one), dr.detail.collect_indices(other)
    if indices[0] or indices[1]:
        return bool(indices[0] == indices[1])
    return bool(np.all(np.equal(one, other)))
