"""The camera as plain numbers, and how a mouse and keys move it: pure functions of poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]

STEEPEST = np.radians(89.0)
"""Largest angle between the view and the horizon: at 90 degrees there is no telling left."""

NEAREST = 1e-3
"""Least distance of the target, relative to the one at the beginning of an orbit's approach."""


@dataclass(frozen=True)
class Pose:
    """
    Where the camera is and what it looks at, in scene units.

    Attributes
    ----------
    origin, target : tuple of 3 floats
        As in Mitsuba's ``look_at``; an orbit goes around the target.
    up : tuple of 3 floats
        The world's upward direction, which stays upward in the picture.
    fov : float or None
        Horizontal field of view in degrees; None where the sensor has none.
    mirrored : bool
        Whether the sensor's transform swaps left and right.
    """

    origin: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float]
    fov: float | None
    mirrored: bool = False

    @property
    def distance(self) -> float:
        """From the camera to its target."""
        return float(np.linalg.norm(np.subtract(self.target, self.origin)))


def pose_of(matrix: npt.ArrayLike, distance: float, fov: float | None) -> Pose:
    """
    The pose of a sensor.

    Parameters
    ----------
    matrix : array_like, (4, 4)
        Its ``to_world``.
    distance : float
        Of what it looks at.
    fov : float or None
    """
    m = np.asarray(matrix, dtype=np.float64)
    origin, forward = m[:3, 3], _unit(m[:3, 2])
    # The world's up is the axis that the picture's up is closest to: no roll by a tilted camera.
    axis = np.zeros(3)
    strongest = int(np.argmax(np.abs(m[:3, 1])))
    axis[strongest] = np.sign(m[strongest, 1]) or 1.0
    if np.linalg.norm(np.cross(forward, axis)) < np.cos(STEEPEST):
        axis = _unit(m[:3, 1])
    mirrored = bool(np.linalg.det(m[:3, :3]) < 0)
    return Pose(_tuple(origin), _tuple(origin + distance * forward), _tuple(axis), fov, mirrored)


def matrix_of(pose: Pose) -> Vector:
    """The ``to_world`` of a pose, (4, 4)."""
    left, up, forward = _frame(pose)
    result = np.eye(4)
    result[:3, :3] = np.stack([-left if pose.mirrored else left, up, forward], axis=1)
    result[:3, 3] = pose.origin
    return result


def orbit(pose: Pose, dx: float, dy: float) -> Pose:
    """Around the target; dx and dy are the mouse's way, in heights of the picture."""
    turned = _turned(pose, _unit(np.subtract(pose.target, pose.origin)), dx, dy)
    return replace(pose, origin=_tuple(np.array(pose.target) - pose.distance * turned))


def look(pose: Pose, dx: float, dy: float) -> Pose:
    """Turn the head; dx and dy are the mouse's way, in heights of the picture."""
    turned = _turned(pose, _unit(np.subtract(pose.target, pose.origin)), dx, dy)
    return replace(pose, target=_tuple(np.array(pose.origin) + pose.distance * turned))


def pan(pose: Pose, dx: float, dy: float) -> Pose:
    """Sideways, so that what is at the target stays under the mouse, for a height of 60 degrees."""
    left, up, _ = _frame(pose)
    side = -left if pose.mirrored else left
    return _moved(pose, pose.distance * (dx * side + dy * up))


def dolly(pose: Pose, amount: float) -> Pose:
    """To the target (above 0) or away from it: by e to the power of the amount."""
    offset = np.subtract(pose.origin, pose.target) * np.exp(-amount)
    if np.linalg.norm(offset) < NEAREST:
        return pose
    return replace(pose, origin=_tuple(np.array(pose.target) + offset))


def fly(pose: Pose, right: float, up: float, forward: float) -> Pose:
    """Through the scene, in scene units along the picture's axes and the world's upward one."""
    left, _, ahead = _frame(pose)
    side = left if pose.mirrored else -left
    return _moved(pose, right * side + up * np.array(pose.up) + forward * ahead)


def project(pose: Pose, points: Vector, size: tuple[int, int]) -> Vector:
    """
    Film positions of world points, in pixels from the picture's centre.

    Parameters
    ----------
    points : array, (..., 3)
    size : (int, int)
        Width and height [pixels].

    Returns
    -------
    array, (..., 2)
        NaN for what is behind the camera.
    """
    left, up, forward = _frame(pose)
    side = left if pose.mirrored else -left
    local = points - np.array(pose.origin)
    depth = local @ forward
    depth = np.where(depth > 0, depth, np.nan)
    scale = 0.5 * size[0] / np.tan(0.5 * np.radians(pose.fov or 60.0))
    return np.asarray(scale * np.stack([local @ side / depth, -(local @ up) / depth], axis=-1))


def keyframe(pose: Pose) -> dict[str, Any]:
    """The pose as a keyframe of a camera path."""
    entry: dict[str, Any] = {"frame": 0}
    entry |= {name: _rounded(getattr(pose, name)) for name in ("origin", "target", "up")}
    if pose.fov is not None:
        entry["fov"] = round(pose.fov, 4)
    return entry


def _frame(pose: Pose) -> tuple[Vector, Vector, Vector]:
    """Left, up and forward, as ``look_at`` has them."""
    forward = _unit(np.subtract(pose.target, pose.origin))
    left = _unit(np.cross(pose.up, forward))
    return left, np.cross(forward, left), forward


def _turned(pose: Pose, forward: Vector, dx: float, dy: float) -> Vector:
    """A direction turned by half a turn for each height of the picture."""
    up = np.array(pose.up)
    ahead = _unit(forward - (forward @ up) * up)
    side = np.cross(up, ahead)
    yaw = np.pi * dx * (-1.0 if pose.mirrored else 1.0)
    elevation = np.arcsin(np.clip(forward @ up, -1.0, 1.0)) - np.pi * dy
    elevation = float(np.clip(elevation, -STEEPEST, STEEPEST))
    level = np.cos(yaw) * ahead - np.sin(yaw) * side
    return np.asarray(np.cos(elevation) * level + np.sin(elevation) * up)


def _moved(pose: Pose, step: Vector) -> Pose:
    return replace(
        pose, origin=_tuple(np.add(pose.origin, step)), target=_tuple(np.add(pose.target, step))
    )


def _unit(vector: npt.ArrayLike) -> Vector:
    v = np.asarray(vector, dtype=np.float64)
    return v / np.linalg.norm(v)


def _tuple(vector: npt.ArrayLike) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in np.asarray(vector))
    return x, y, z


def _rounded(vector: tuple[float, ...]) -> list[float]:
    return [round(value, 6) for value in vector]
