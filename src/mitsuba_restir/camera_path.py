"""Camera paths: keyframes of a view, interpolated per frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from . import curves
from .errors import UsageError

DEFAULT_FPS = 24.0
_KEYS = ("frame", "time", "origin", "target", "up", "fov")
_TOP_KEYS = ("fps", "interpolation", "keyframes")
_VANISHED = 1e-6  # of what the keyframes have: what rounding leaves of a view that cancels


@dataclass(frozen=True)
class Pose:
    """
    A camera at one frame, in scene units.

    Fields
    ------
    origin, target, up : arrays of 3
        As in Mitsuba's ``look_at``.
    fov : float or None
        Horizontal field of view in degrees; None keeps the sensor's.
    """

    origin: npt.NDArray[np.float64]
    target: npt.NDArray[np.float64]
    up: npt.NDArray[np.float64]
    fov: float | None


@dataclass(frozen=True)
class CameraPath:
    """
    Keyframes of a view and what is between them; the ends are held.

    Fields
    ------
    frames : array, (K,)
        Frame numbers, strictly increasing; fractions are allowed.
    vectors : array, (K, 3, 3)
        Origin, target and up of each keyframe.
    fovs : array, (K,), or None
        Horizontal field of view in degrees.
    interpolation : str
        One of :data:`mitsuba_restir.curves.INTERPOLATIONS`.
    """

    frames: npt.NDArray[np.float64]
    vectors: npt.NDArray[np.float64]
    fovs: npt.NDArray[np.float64] | None
    interpolation: str = "smooth"

    @property
    def length(self) -> int:
        """Number of frames up to and including the last keyframe."""
        return int(np.floor(self.frames[-1])) + 1

    def pose(self, frame: float) -> Pose:
        """Interpolate the camera at a frame."""
        origin, target, up = self._vectors_at(np.array([frame]))[0]
        fov = None
        if self.fovs is not None:
            curve = curves.numbers(self.frames, self.fovs[:, None], self.interpolation)
            fov = float(curve(frame)[0])
        return Pose(origin, target, up, fov)

    def check(self, frames: int) -> None:
        """
        Make sure that the camera looks somewhere in each of the first frames.

        Between two keyframes the view can vanish, or lie along ``up``, although it does so in
        neither: halfway of a turn by 180 degrees the target is where the camera is.

        Parameters
        ----------
        frames : int
            How many frames are going to be rendered.

        Raises
        ------
        UsageError
            A frame has no view; names the first one.
        """
        shown = np.arange(min(frames, self.length))
        usual = np.interp(shown, self.frames, _clearness(self.vectors))
        lost = np.flatnonzero(_clearness(self._vectors_at(shown)) <= _VANISHED * usual)
        if lost.size:
            before = int(np.searchsorted(self.frames, lost[0], side="right")) - 1
            raise UsageError(
                f"frame {lost[0]}, between keyframes {before} and {before + 1}, has no view: its "
                "target is at its origin, or in the direction of up; add a keyframe there, so that "
                "no turn is by 180 degrees at once"
            )

    def _vectors_at(self, frames: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        """Origin, target and up at each frame, (N,) to (N, 3, 3)."""
        flat = self.vectors.reshape(len(self.frames), 9)
        return curves.points(self.frames, flat, self.interpolation)(frames).reshape(-1, 3, 3)


def _clearness(vectors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """|(target - origin) x up|, which is zero where there is no view, (N, 3, 3) to (N,)."""
    origin, target, up = np.moveaxis(vectors, 1, 0)
    return np.asarray(np.linalg.norm(np.cross(target - origin, up), axis=-1))


def from_data(data: Any) -> CameraPath:
    """
    Build a camera path from ``{"fps": 24, "keyframes": [{"frame": 0, "origin": [..], ..}, ..]}``.

    Each keyframe has ``frame`` or ``time`` (seconds, times ``fps``), ``origin``, ``target`` and
    optionally ``up`` (0, 1, 0) and ``fov`` (horizontal, degrees; in all keyframes or in none).
    ``interpolation`` is ``smooth`` unless it is ``linear``.

    Raises
    ------
    UsageError
        Something is missing or wrong; says where and what is allowed.
    """
    if not isinstance(data, Mapping) or not isinstance(data.get("keyframes"), Sequence):
        raise UsageError("a list 'keyframes' is needed at the top level")
    refuse_unknown(data, _TOP_KEYS, "the top level")
    fps, interpolation = frames_per_second(data), interpolation_of(data, "the top level")
    keyframes = data["keyframes"]
    if not keyframes:
        raise UsageError("at least one keyframe is needed")
    frames, vectors, fovs = [], [], []
    for index, key in enumerate(keyframes):
        where = f"keyframe {index}"
        if not isinstance(key, Mapping):
            raise UsageError(f"{where} must be a table of {', '.join(_KEYS)}")
        refuse_unknown(key, _KEYS, where)
        frames.append(frame_of(key, fps, where))
        vectors.append(_vectors(key, where))
        if "fov" in key:
            fovs.append(_fov(key["fov"], where))
    if len(fovs) not in (0, len(frames)):
        raise UsageError("'fov' must be given in all keyframes or in none")
    check_times(frames, "the keyframes")
    return CameraPath(
        np.array(frames), np.array(vectors), np.array(fovs) if fovs else None, interpolation
    )


def frames_per_second(data: Mapping[str, Any]) -> float:
    """``fps`` of a file."""
    fps = number(data.get("fps", DEFAULT_FPS), "fps")
    if not fps > 0:
        raise UsageError(f"fps must be above 0, not {fps:g}")
    return fps


def interpolation_of(table: Mapping[str, Any], where: str, default: str = "smooth") -> str:
    """``interpolation`` of a file or a track."""
    word = table.get("interpolation", default)
    if word not in curves.INTERPOLATIONS:
        allowed = ", ".join(curves.INTERPOLATIONS)
        raise UsageError(f"{where}: interpolation must be one of {allowed}, not {word!r}")
    return str(word)


def frame_of(key: Mapping[str, Any], fps: float, where: str) -> float:
    """The frame number of a keyframe, from ``frame`` or ``time``."""
    if ("frame" in key) == ("time" in key):
        raise UsageError(f"{where} needs either 'frame' or 'time'")
    if "time" in key:
        return number(key["time"], f"{where}: time") * fps
    return number(key["frame"], f"{where}: frame")


def check_times(frames: Sequence[float], what: str) -> None:
    """Make sure that the frame numbers of keyframes increase from 0 or later."""
    if frames[0] < 0 or np.any(np.diff(frames) <= 0):
        raise UsageError(f"the times of {what} must not be negative and must increase")


def refuse_unknown(table: Mapping[str, Any], allowed: Sequence[str], where: str) -> None:
    """Refuse keys that nobody reads."""
    for name in table:
        if name not in allowed:
            raise UsageError(f"{where} has an unknown '{name}'; allowed are {', '.join(allowed)}")


def number(value: Any, what: str) -> float:
    """A finite number of a file."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise UsageError(f"{what} must be a finite number, not {value!r}")
    return float(value)


def _fov(value: Any, where: str) -> float:
    fov = number(value, f"{where}: fov")
    if not 0.0 < fov < 180.0:
        raise UsageError(f"{where}: fov must be between 0 and 180 degrees, not {fov:g}")
    return fov


def vector(value: Any, where: str, name: str) -> list[float]:
    """Three finite numbers of a file."""
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 3:
        raise UsageError(f"{where}: {name} must be a list of three numbers")
    return [number(entry, f"{where}: {name}") for entry in value]


def _vectors(key: Mapping[str, Any], where: str) -> list[list[float]]:
    vectors: list[list[float]] = []
    for name in ("origin", "target", "up"):
        vectors.append(vector(key.get(name, [0, 1, 0] if name == "up" else None), where, name))
    origin, target, up = np.array(vectors)
    if not np.any(np.abs(np.cross(target - origin, up)) > 1e-9):
        raise UsageError(f"{where}: the view from origin to target must not be zero or along up")
    return vectors
