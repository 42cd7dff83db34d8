"""The command that renders what is shown."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field

from ..integrators.declaration import Value
from .camera import Pose, keyframe
from .model import Side

WARM_UP = 20
"""Frames of history before the one that is kept."""

CAMERA = "view.json"

_AOVS = {
    "albedo": "albedo",
    "normal": "sh_normal",
    "depth": "depth",
    "motion": "motion",
    "confidence": "confidence",
    "duplication": "path",
    "acceptance": "mutation",
}
"""The auxiliary image that has what a view shows."""


@dataclass(frozen=True)
class Subject:
    """
    What the viewer was started with, as words of the command line.

    Attributes
    ----------
    scene : str
        Empty where it was given as an object, which no command can name.
    title : str
        What the page calls it.
    definitions : mapping of str to str
    variant : str or None
    sensor, seed : int
    """

    scene: str
    title: str
    definitions: Mapping[str, str] = field(default_factory=dict)
    variant: str | None = None
    sensor: int = 0
    seed: int = 0


def command(subject: Subject, side: Side, size: tuple[int, int], pose: Pose | None) -> str:
    """
    Lines for a shell that render a side as it is shown, with a history of its own.

    Parameters
    ----------
    subject : Subject
    side : Side
    size : (int, int)
        Width and height [pixels].
    pose : Pose or None
        None where the camera is where the scene has it.
    """
    words = ["mitsuba-restir", "render", subject.scene, "--resolution", f"{size[0]}x{size[1]}"]
    words += ["--warmup", str(WARM_UP), "--spp", str(side.spp), "--seed", str(subject.seed)]
    words += ["-m", subject.variant] if subject.variant else []
    words += ["-s", str(subject.sensor)] if subject.sensor else []
    for name, text in subject.definitions.items():
        words += ["-D", f"{name}={text}"]
    parameters = dict(side.parameters)
    if side.view == "denoised":
        words.append("--denoise")
        # It would take a preset of its own.
        parameters = {"preset": "none", **parameters}
    for name, value in parameters.items():
        words += ["-p", f"{name}={_word(value)}"]
    if side.view in _AOVS:
        words += ["--aovs", _AOVS[side.view]]
    lines = []
    if pose is not None:
        path = json.dumps({"keyframes": [keyframe(pose)]})
        lines.append(f"printf '%s' {shlex.quote(path)} > {CAMERA}")
        words += ["--camera-path", CAMERA]
        if pose.mirrored:
            lines.append("# The scene's camera is mirrored, one of a camera path is not.")
    return "\n".join([*lines, shlex.join([*words, "-o", "view.exr"])])


def _word(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
