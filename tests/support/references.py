"""References: what Mitsuba's ``path`` renders, with the variance of every value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import zoo

from . import rooms

FOLDER = Path(__file__).resolve().parents[1] / "references"

BATCHES = 32


@dataclass(frozen=True)
class Case:
    """A scene and how ``path`` renders it.

    ``edit`` maps parameters of the loaded scene (``mi.traverse``) to new values; ``spp`` is the
    number of samples per pixel of the whole reference.
    """

    scene: Callable[[], dict[str, Any]]
    max_depth: int = 5
    spp: int = 32768
    variant: str = "llvm_ad_rgb"
    hide_emitters: bool = False
    edit: dict[str, Any] = field(default_factory=dict)

    def load(self) -> mi.Scene:
        return mi.load_dict(self.scene())


LAMP_MOVED = [-0.3, 1.1, 0.3]

CASES = {
    "bsdfs": Case(zoo.bsdf_zoo),
    "emitters": Case(zoo.emitter_zoo, max_depth=4),
    "envmap": Case(zoo.envmap_scene, max_depth=4),
    "sunsky": Case(zoo.sunsky_scene, max_depth=4),
    "shapes": Case(zoo.SCENES["shapes"], max_depth=4),
    "glossy_shapes": Case(zoo.SCENES["glossy_shapes"], max_depth=4),
    "room": Case(rooms.room),
    "room_depth_2": Case(rooms.room, max_depth=2),
    "room_unlimited": Case(rooms.room, max_depth=-1),
    "room_visible": Case(lambda: rooms.room(light_in_view=True)),
    "room_hidden": Case(lambda: rooms.room(light_in_view=True), hide_emitters=True),
    "room_lens": Case(lambda: rooms.room(lens=True)),
    "room_spectral": Case(rooms.room, variant="llvm_ad_spectral"),
    "room_mono": Case(rooms.room, variant="llvm_ad_mono"),
    "room_lamp_off": Case(rooms.room, edit={"light.emitter.radiance.value": 0.0}),
    "furniture": Case(rooms.furniture),
    "open_room": Case(rooms.open_room),
    "open_room_moved": Case(rooms.open_room, edit={"lamp.position": LAMP_MOVED}),
    "far_room": Case(lambda: rooms.open_room(50.0), max_depth=7),
    "corner_small": Case(lambda: rooms.corner(scale=1e-3)),
    "corner_away": Case(lambda: rooms.corner(x=1e3)),
    "grooves": Case(rooms.grooves, max_depth=4),
}


def edit_scene(scene: mi.Scene, values: dict[str, Any]) -> None:
    """Set parameters of a loaded scene."""
    if not values:
        return
    parameters = mi.traverse(scene)
    for key, value in values.items():
        parameters[key] = type(parameters[key])(value)
    parameters.update()


def make(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of the mean, (H, W, 3) each."""
    mi.set_variant(case.variant)
    scene = case.load()
    edit_scene(scene, case.edit)
    path = mi.load_dict(
        {"type": "path", "max_depth": case.max_depth, "hide_emitters": case.hide_emitters}
        | ({} if case.max_depth == -1 else {"rr_depth": 1000})
    )
    batches = np.stack(
        [
            np.array(
                mi.render(scene, integrator=path, spp=case.spp // BATCHES, seed=seed),
                dtype=np.float64,
            )[..., :3]
            for seed in range(BATCHES)
        ]
    )
    return batches.mean(axis=0), batches.var(axis=0, ddof=1) / BATCHES


def save(name: str, mean: np.ndarray, variance: np.ndarray) -> None:
    FOLDER.mkdir(exist_ok=True)
    np.savez_compressed(
        FOLDER / f"{name}.npz",
        mean=mean.astype(np.float32),
        error=np.sqrt(variance).astype(np.float16),
    )


def load(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of a committed reference; rounding to single precision is negligible."""
    with np.load(FOLDER / f"{name}.npz") as data:
        return data["mean"].astype(np.float64), data["error"].astype(np.float64) ** 2
