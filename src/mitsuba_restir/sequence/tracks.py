"""Tracks of an animation: the keyframes of one parameter, and what is between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from .. import curves
from ..camera_path import check_times, frame_of, interpolation_of, number, refuse_unknown, vector
from ..errors import UsageError
from ..transforms import Matrix

_KEYS = ("parameter", "interpolation", "pivot", "keyframes")
_TIMES = ("frame", "time")
_TRANSFORM = ("translate", "rotate", "scale")
_HALF_TURN = np.pi - 1e-6


@dataclass(frozen=True)
class Values:
    """
    A colour, a vector or a number over time.

    Fields
    ------
    parameter : str
        As ``mi.traverse`` names it.
    last : float
        Frame number of the last keyframe.
    size : int
        How many numbers a value has.
    at : callable
        Frame number -> array, (size,).
    """

    parameter: str
    last: float
    size: int
    at: Callable[[float], npt.NDArray[np.float64]]


@dataclass(frozen=True)
class Motion:
    """
    A transform over time, relative to the place that the object has in the scene.

    Fields
    ------
    parameter, last
        As in :class:`Values`.
    pivot : array of 3, or None
        What it turns and scales about, in the scene; None is the object's own origin.
    offset, rotation, scale : callables
        Frame number -> array of 3, Rotation, array of 3.
    """

    parameter: str
    last: float
    pivot: npt.NDArray[np.float64] | None
    offset: Callable[[float], npt.NDArray[np.float64]]
    rotation: Callable[[float], Rotation]
    scale: Callable[[float], npt.NDArray[np.float64]]

    def at(self, frame: float, origin: npt.NDArray[np.float64]) -> Matrix:
        """What takes the object from its place in the scene to that of a frame, (4, 4).

        Parameters
        ----------
        origin : array of 3
            The object's own, in the scene.
        """
        pivot = origin if self.pivot is None else self.pivot
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation(frame).as_matrix() @ np.diag(self.scale(frame))
        matrix[:3, 3] = pivot + self.offset(frame) - matrix[:3, :3] @ pivot
        return matrix


Track = Values | Motion


def track_of(data: Any, index: int, fps: float, interpolation: str) -> Track:
    """
    Read one track.

    Parameters
    ----------
    data
        A table of ``parameter``, ``keyframes`` and, if wanted, ``interpolation`` and ``pivot``.
    index : int
        Its number, for errors.
    fps : float
    interpolation : str
        Of tracks that do not say.

    Raises
    ------
    UsageError
        Something is missing or wrong; says where and what is allowed.
    """
    where = f"track {index}"
    if not isinstance(data, Mapping) or not isinstance(data.get("parameter"), str):
        raise UsageError(f"{where} needs a 'parameter', as mi.traverse names it")
    name = data["parameter"]
    where = f"{where} ({name})"
    refuse_unknown(data, _KEYS, where)
    keys = data.get("keyframes")
    if not isinstance(keys, Sequence) or isinstance(keys, str) or not keys:
        raise UsageError(f"{where} needs a list 'keyframes' with at least one")
    kind = interpolation_of(data, where, interpolation)
    moves = name.rpartition(".")[2] == "to_world"
    allowed = (*_TIMES, *(_TRANSFORM if moves else ("value",)))
    for i, key in enumerate(keys):
        if not isinstance(key, Mapping):
            raise UsageError(f"{where}: keyframe {i} must be a table of {', '.join(allowed)}")
        refuse_unknown(key, allowed, f"{where}: keyframe {i}")
    places = [f"{where}: keyframe {i}" for i in range(len(keys))]
    frames = [frame_of(key, fps, place) for key, place in zip(keys, places, strict=True)]
    check_times(frames, where)
    times = np.array(frames)
    if moves:
        return _motion(data, keys, places, times, kind)
    if "pivot" in data:
        raise UsageError(f"{where}: 'pivot' is for transforms, whose names end in to_world")
    return _values(name, keys, places, times, kind)


def _values(
    name: str,
    keys: Sequence[Mapping[str, Any]],
    places: Sequence[str],
    times: npt.NDArray[np.float64],
    kind: str,
) -> Values:
    rows = []
    for key, place in zip(keys, places, strict=True):
        value = key.get("value")
        entries = value if isinstance(value, list) else [value]
        if not entries or value is None:
            raise UsageError(f"{place} needs a 'value', a number or a list of numbers")
        rows.append([number(entry, f"{place}: value") for entry in entries])
    if len({len(row) for row in rows}) > 1:
        raise UsageError(f"{places[0]} and others have values of different lengths")
    # The place of a light is a point, and moves as points do.
    through = curves.points if name.rpartition(".")[2] == "position" else curves.numbers
    curve = through(times, np.array(rows), kind)
    return Values(name, float(times[-1]), len(rows[0]), curve)


def _motion(
    data: Mapping[str, Any],
    keys: Sequence[Mapping[str, Any]],
    places: Sequence[str],
    times: npt.NDArray[np.float64],
    kind: str,
) -> Motion:
    offsets, turns, scales = [], [], []
    for key, place in zip(keys, places, strict=True):
        offsets.append(vector(key.get("translate", [0, 0, 0]), place, "translate"))
        turns.append(_turn(key.get("rotate"), place))
        scales.append(_scale(key.get("scale", 1), place))
    rotations = Rotation.concatenate(turns)
    angles = (rotations[:-1].inv() * rotations[1:]).magnitude() if len(keys) > 1 else np.zeros(0)
    given = np.diff([_angle(key.get("rotate")) for key in keys])
    for i, (angle, step) in enumerate(zip(angles, given, strict=True)):
        axes = [_axis(key.get("rotate")) for key in keys[i : i + 2]]
        same = axes[0] == axes[1] or None in axes
        if angle >= _HALF_TURN or (same and abs(step) >= 180):
            raise UsageError(
                f"{places[i + 1]} turns by 180 degrees or more at once; add a keyframe between it "
                "and the one before, which says which way"
            )
    pivot = data.get("pivot")
    return Motion(
        str(data["parameter"]),
        float(times[-1]),
        None if pivot is None else np.array(vector(pivot, places[0].split(":")[0], "pivot")),
        curves.points(times, np.array(offsets), kind),
        curves.rotations(times, rotations),
        curves.numbers(times, np.array(scales), kind),
    )


def _turn(value: Any, place: str) -> Rotation:
    if value is None:
        return Rotation.identity()
    if not isinstance(value, Mapping) or set(value) != {"axis", "angle"}:
        raise UsageError(f"{place}: rotate must be a table of axis and angle (degrees)")
    axis = np.array(vector(value["axis"], place, "axis"))
    length = np.linalg.norm(axis)
    if not length > 0:
        raise UsageError(f"{place}: axis must not be zero")
    angle = np.radians(number(value["angle"], f"{place}: angle"))
    return Rotation.from_rotvec(axis / length * angle)


def _angle(value: Any) -> float:
    return 0.0 if value is None else float(value["angle"])


def _axis(value: Any) -> Any:
    return None if value is None else list(value["axis"])


def _scale(value: Any, place: str) -> list[float]:
    scale = [value] * 3 if not isinstance(value, list) else vector(value, place, "scale")
    scale = [number(entry, f"{place}: scale") for entry in scale]
    if not min(scale) > 0:
        raise UsageError(f"{place}: scale must be above 0")
    return scale
