"""Digests of the frames of every mode, to show that a change of the code left every bit as it was.

    python -m benchmarks.digests write FILE      # at the old commit: PYTHONPATH=OLD/src
    python -m benchmarks.digests compare FILE    # at the new one, on the same machine

Every mode renders 6 frames of 64x36 pixels. A mode that differs is named with its first such frame.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mitsuba_restir  # noqa: F401  isort: skip  (before Mitsuba: it finds the LLVM)

import mitsuba as mi
import numpy as np

from mitsuba_restir import scenes

WIDTH, HEIGHT, FRAMES = 64, 36, 6

Edit = Callable[[Any, Mapping[str, Any], int], None]
"""Changes a scene's parameters before frame t, given those that it started with."""


@dataclass(frozen=True)
class Mode:
    """What is rendered, beside the integrator's parameters."""

    parameters: Mapping[str, Any] = field(default_factory=dict)
    scene: str = "ajar"
    variant: str = "llvm_ad_rgb"
    spp: int = 1
    lens: bool = False
    edit: Edit | None = None


def _translated(start: Any, x: float, y: float, z: float) -> Any:
    matrix = np.array(start.matrix, dtype=np.float64).reshape(4, 4)
    return mi.ScalarTransform4f().translate([x, y, z]) @ mi.ScalarTransform4f(matrix)


def _move_camera(parameters: Any, start: Mapping[str, Any], t: int) -> None:
    parameters["sensor.to_world"] = _translated(start["sensor.to_world"], 0.02 * t, 0.01 * t, 0)


def _move_light(parameters: Any, start: Mapping[str, Any], t: int) -> None:
    parameters["light.to_world"] = _translated(start["light.to_world"], 0.1 * t, 0, 0.05 * t)


_MUTATED = {"mutations": 2}
_CHANNELS = "albedo, sh_normal, depth, position, motion, confidence"

MODES: dict[str, Mode] = {
    "default": Mode(),
    "candidates": Mode({"temporal": False, "spatial": False}),
    "candidates_4": Mode({"temporal": False, "spatial": False}, spp=4),
    "temporal": Mode({"spatial": False}),
    "spatial": Mode({"temporal": False}),
    "rounds": Mode({"spatial_rounds": 3, "spatial_neighbors": 5, "spatial_radius": 8.0}),
    "trees": Mode({"confidence_cap": 50.0}, spp=3),
    "short": Mode({"max_depth": 3, "rr_depth": 2}),
    "hidden": Mode({"hide_emitters": True}, scene="cornell"),
    "cornell": Mode(scene="cornell"),
    "gloss": Mode(scene="gloss"),
    "court": Mode(scene="court"),
    "reconnection": Mode({"shift": "reconnection"}),
    "random_replay": Mode({"shift": "random_replay"}),
    "distance": Mode({"connectability": "distance_roughness"}, scene="gloss"),
    "ranked": Mode({"neighbor_sampling": "blue_noise", "spatial_rounds": 2}),
    "white": Mode({"neighbor_sampling": "white_noise"}),
    "blocks": Mode({"neighbor_sampling": "blocks"}),
    "scored": Mode({"neighbor_sampling": "geometry"}),
    "mutated": Mode(_MUTATED),
    "mutated_court": Mode(_MUTATED, scene="court"),
    "mutated_gloss": Mode({**_MUTATED, "mutation_step": 0.2}, scene="gloss"),
    "mutated_in_turns": Mode({**_MUTATED, "mutation_interval": 3}),
    "mutated_by_energy": Mode({**_MUTATED, "mutation_acceptance": "energy"}),
    "mutated_by_energy_updated": Mode(
        {**_MUTATED, "mutation_acceptance": "energy_updated", "blue_noise_weight": 0.8}
    ),
    "mutated_retraced": Mode({**_MUTATED, "retrace_history": True}, scene="court"),
    "selection": Mode({"blue_noise": "selection", "spatial_rounds": 2}),
    "selection_ranked": Mode(
        {**_MUTATED, "blue_noise": "selection", "neighbor_sampling": "blue_noise"}
    ),
    "selection_retraced": Mode(
        {"blue_noise": "selection", "retrace_history": True, "aovs": "history"},
        scene="cornell",
        edit=_move_light,
    ),
    "guided": Mode({"guiding": True}),
    "guided_retraced": Mode(
        {"guiding": True, "retrace_history": True, **_MUTATED}, scene="cornell"
    ),
    "seeds": Mode({"blue_noise_seeds": True, **_MUTATED}),
    "moving_camera": Mode(edit=_move_camera, scene="cornell"),
    "moving_camera_selection": Mode(
        {"blue_noise": "selection", "aovs": "motion"}, edit=_move_camera, scene="cornell"
    ),
    "moving_light": Mode({"retrace_history": True}, scene="cornell", edit=_move_light),
    "lens": Mode(scene="cornell", lens=True, edit=_move_camera),
    "images": Mode({**_MUTATED, "aovs": _CHANNELS + ", mutation, path"}),
    "images_mono": Mode({"aovs": _CHANNELS}, variant="llvm_ad_mono"),
    "spectral": Mode(_MUTATED, variant="llvm_ad_spectral", scene="cornell"),
    "spectral_retraced": Mode(
        {"retrace_history": True}, variant="llvm_ad_spectral", scene="cornell"
    ),
    "mono": Mode({**_MUTATED, "neighbor_sampling": "blue_noise"}, variant="llvm_ad_mono"),
}


def frames(mode: Mode) -> Iterator[np.ndarray]:
    """The frames of a mode (H, W, channels)."""
    if mi.variant() != mode.variant:
        mi.set_variant(mode.variant)
    description = scenes.as_dict(mode.scene, WIDTH, HEIGHT)
    if mode.lens:
        lens = {"type": "thinlens", "aperture_radius": 0.05, "focus_distance": 3.0}
        description["sensor"] = {**description["sensor"], **lens}
    # As :func:`mitsuba_restir.scenes.load` does, so that lights come in order.
    scene = mi.load_dict(description, optimize=False)
    parameters = mi.traverse(scene)
    start = {name: type(value)(value) for name, value in parameters if "to_world" in name}
    integrator = mi.load_dict({"type": "restir_pt", "max_depth": 8, **mode.parameters})
    for t in range(FRAMES):
        if mode.edit is not None and t > 0:
            mode.edit(parameters, start, t)
            parameters.update()
        yield np.array(mi.render(scene, integrator=integrator, seed=7, spp=mode.spp))


def digests(names: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Name of each mode and the SHA-256 of each of its frames."""
    for name in names:
        found = []
        for frame in frames(MODES[name]):
            found.append(hashlib.sha256(np.ascontiguousarray(frame).tobytes()).hexdigest())
        yield name, found


def main() -> int:
    """Write or compare digests; the exit code is 1 where a mode differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", choices=("write", "compare"))
    parser.add_argument("file", type=Path)
    parser.add_argument("--modes", nargs="*", choices=list(MODES), default=list(MODES))
    arguments = parser.parse_args()
    known = {} if arguments.action == "write" else json.loads(arguments.file.read_text())
    different = 0
    for name, found in digests(arguments.modes):
        if arguments.action == "write":
            known[name] = found
            arguments.file.write_text(json.dumps(known, indent=1))
            print(f"{name}: written", flush=True)
            continue
        pairs = zip(known[name], found, strict=True)
        frame = next((t for t, (a, b) in enumerate(pairs) if a != b), None)
        different += frame is not None
        print(f"{name}: {'equal' if frame is None else f'DIFFERS from frame {frame}'}", flush=True)
    if arguments.action == "compare":
        print(f"{len(arguments.modes) - different} of {len(arguments.modes)} modes are equal")
    return int(different > 0)


if __name__ == "__main__":
    sys.exit(main())
