"""Animations: keyframes of the camera and of anything else in a scene, from a file."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from .. import camera_path
from ..camera_path import CameraPath, frames_per_second, interpolation_of, refuse_unknown
from ..errors import UsageError, one_line
from .targets import Placement, placement
from .tracks import Track, track_of

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_TOP_KEYS = ("fps", "interpolation", "keyframes", "tracks")


@dataclass(frozen=True)
class Animation:
    """
    What moves over time.

    Fields
    ------
    fps : float
        Frames per second.
    camera : CameraPath or None
    tracks : tuple of Track
    """

    fps: float
    camera: CameraPath | None
    tracks: tuple[Track, ...]

    @property
    def length(self) -> int:
        """Number of frames up to and including the last keyframe."""
        ends = [track.last for track in self.tracks]
        if self.camera is not None:
            ends.append(float(self.camera.frames[-1]))
        return int(np.floor(max(ends))) + 1

    def check(self, frames: int) -> None:
        """Make sure that the camera looks somewhere in each of the first frames."""
        if self.camera is not None:
            self.camera.check(frames)

    def bind(self, scene: mi.Scene, sensor: mi.Sensor | None = None) -> Placement:
        """
        What puts a scene to a frame of the animation; call it with the frame's number.

        Parameters
        ----------
        scene : Scene
            As it was loaded: transforms are relative to the places that objects have now.
        sensor : Sensor, optional
            What the keyframes of the camera move, the scene's first by default.

        Raises
        ------
        UsageError
            The scene has no such parameter, or it is of another kind.
        """
        return placement(scene, sensor or scene.sensors()[0], self.camera, self.tracks)


def load(path: Path | str) -> Animation:
    """
    Read an animation, or a camera path, which is one of the camera alone.

    Raises
    ------
    UsageError
        The file is missing, is neither JSON nor TOML, or something in it is wrong; says what.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise UsageError(f"cannot read the animation {path}: {reason}") from error
    try:
        if path.suffix.lower() == ".json":
            data = json.loads(text)
        elif path.suffix.lower() == ".toml":
            data = tomllib.loads(text)
        else:
            raise UsageError(f"the animation {path} must be a .json or a .toml file")
    except (ValueError, RecursionError) as error:
        raise UsageError(f"the animation {path} cannot be parsed: {one_line(error)}") from error
    try:
        return from_data(data)
    except UsageError as error:
        raise UsageError(f"animation {path}: {error}") from error


def from_data(data: Any) -> Animation:
    """
    Build an animation from what its file says; ``docs/animation.md`` has the format.

    Raises
    ------
    UsageError
        Something is missing or wrong; says where and what is allowed.
    """
    if not isinstance(data, Mapping) or not {"keyframes", "tracks"} & set(data):
        raise UsageError(
            "a list 'keyframes' (of the camera) or 'tracks' is needed at the top level"
        )
    refuse_unknown(data, _TOP_KEYS, "the top level")
    fps, interpolation = frames_per_second(data), interpolation_of(data, "the top level")
    camera = None
    if "keyframes" in data:
        camera = camera_path.from_data({k: v for k, v in data.items() if k != "tracks"})
    rows = data.get("tracks", [])
    if not isinstance(rows, Sequence) or isinstance(rows, str):
        raise UsageError("'tracks' must be a list")
    if not rows and camera is None:
        raise UsageError("at least one track is needed")
    tracks = tuple(track_of(row, i, fps, interpolation) for i, row in enumerate(rows))
    names = [track.parameter for track in tracks]
    for name in names:
        if names.count(name) > 1:
            raise UsageError(f"{name} has more than one track")
    return Animation(fps, camera, tracks)
