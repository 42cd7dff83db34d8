"""Where objects are: the one place that reads and writes ``to_world``.

Mitsuba 3.9 keeps one transform per object. Later versions will nest it one level deeper, as they
animate it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

TO_WORLD = "to_world"
"""Last part of the name of a parameter that is a transform."""

Matrix = npt.NDArray[np.float64]

_RIGID = 1e-4
"""How far a turned unit vector may be from what a rotation makes of it: rounding of single
precision, through an inverse."""


def matrix_of(parameters: Any, name: str = TO_WORLD) -> Matrix:
    """A transform as a matrix, (4, 4)."""
    return np.array(parameters[name].matrix, dtype=np.float64).reshape(4, 4)


def set_matrix(parameters: Any, name: str, matrix: Matrix) -> None:
    """Write a transform; it takes effect with ``parameters.update()``."""
    transform = mi.ScalarTransform4f(matrix)
    parameters[name] = type(parameters[name])(transform.matrix)
    dr.make_opaque(parameters[name])


def world_to_local(parameters: Any, name: str = TO_WORLD) -> mi.Matrix4f:
    """The inverse of a transform, on the device."""
    return mi.Matrix4f(parameters[name].inverse().matrix)


def look_at(origin: Sequence[float], target: Sequence[float], up: Sequence[float]) -> Matrix:
    """The transform of a sensor that looks from ``origin`` to ``target``."""
    transform = mi.ScalarTransform4f().look_at(list(origin), list(target), list(up))
    return np.array(transform.matrix, dtype=np.float64)


def transform_names(parameters: Any) -> list[str]:
    """Names of all parameters that are transforms of objects."""
    return [name for name in parameters.keys() if name.rpartition(".")[2] == TO_WORLD]


def is_rigid(matrix: Matrix) -> bool:
    """Whether a transform only turns and moves."""
    linear = matrix[:3, :3]
    return bool(
        np.linalg.det(linear) > 0 and np.allclose(linear @ linear.T, np.eye(3), rtol=0, atol=_RIGID)
    )


def on_device(matrix: Matrix) -> mi.Matrix4f:
    """A matrix in memory of the device, so that no kernel is compiled for its entries."""
    result = mi.Matrix4f(mi.ScalarTransform4f(matrix).matrix)
    dr.make_opaque(result)
    return result


def moved_points(points: mi.Point3f, matrix: mi.Matrix4f) -> mi.Point3f:
    """Points under an affine transform."""
    return mi.Point3f((matrix @ mi.Vector4f(points.x, points.y, points.z, 1)).xyz)


def moved_normals(normals: mi.Normal3f, cofactors: mi.Matrix4f) -> mi.Normal3f:
    """Unit normals under an affine transform, see :func:`cofactors`; what is zero stays so."""
    turned = (cofactors @ mi.Vector4f(normals.x, normals.y, normals.z, 0)).xyz
    length = dr.norm(turned)
    return mi.Normal3f(dr.select(length > 0, turned / length, 0))


def cofactors(matrix: Matrix) -> Matrix:
    """What turns normals where ``matrix`` moves points: its linear part inverted and transposed."""
    result = np.eye(4)
    result[:3, :3] = np.linalg.inv(matrix[:3, :3]).T
    return result
