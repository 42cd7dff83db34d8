"""What a seed stands for: a random scene, random parameters, and how many edits there are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np
import zoo
from support import edits

Scene = dict[str, Any]

OPAQUE = (
    "diffuse",
    "textured",
    "roughconductor",
    "roughconductor_sharp",
    "roughconductor_aniso",
    "conductor",
    "plastic",
    "roughplastic",
    "principled",
)
"""BSDFs that may be wrapped by ``twosided``."""

WITHOUT_CAUSTICS = ("diffuse", "textured", "roughconductor", "roughplastic", "principled")
"""BSDFs under a sun: a smooth one would make caustics of it, which no path tracer finds."""

BLACK = {"type": "constant", "radiance": 0.0}
"""A sky of no light."""

NOT_RECORDED = "ellipsoidsmesh"
"""Frames with this shape are traced every time, and take ten times as long."""

BIASED = (
    {"blue_noise": "selection", "temporal": True, "spatial": True},
    {"mutation_acceptance": "energy", "mutations": 1, "mutation_interval": 1},
)


@dataclass(frozen=True)
class Combination:
    """What a seed stands for.

    Fields: ``variant``, ``scene`` (for ``mi.load_dict``), ``parameters`` (of ``restir_pt``),
    ``spp``, ``runs`` (of a test of bias), ``frames`` (of a run), ``edits`` (how many come between
    frames), ``moving`` (whether the camera comes to rest in the last frame of a run), ``names`` (of
    what the scene is made of).
    """

    variant: str
    scene: Scene
    parameters: dict[str, Any]
    spp: int
    runs: int
    frames: int
    edits: int
    moving: bool
    names: dict[str, list[str]]


def generator(seed: int, purpose: int) -> np.random.Generator:
    """Random numbers of a seed; ``purpose`` separates those of a scene from those of its edits."""
    return np.random.default_rng([seed, purpose])


def combination(seed: int) -> Combination:
    """The combination of a seed; sets the variant of Mitsuba that it is for."""
    rng = generator(seed, 0)
    variant = "llvm_ad_mono" if rng.random() < 0.1 else "llvm_ad_rgb"
    if mi.variant() != variant:
        mi.set_variant(variant)
    scene, names = _scene(rng)
    parameters = _parameters(rng)
    if variant == "llvm_ad_mono":
        del parameters["aovs"]  # the tests take the first three channels for the picture
    return Combination(
        variant,
        scene,
        parameters,
        spp=int(rng.choice([1, 1, 2, 4])),
        runs=32 if NOT_RECORDED in names["shapes"] else 128,
        frames=int(rng.integers(2, 5)) if parameters["temporal"] else 1,
        edits=int(rng.integers(1, 4)),
        moving=bool(rng.random() < 0.4),
        names=names,
    )


# --------------------------------- scenes -------------------------------------------------------


def _scene(rng: np.random.Generator) -> tuple[Scene, dict[str, list[str]]]:
    sensor = _sensor(rng)
    sky_name, sky = _sky(rng)
    scene: Scene = {"type": "scene", "sensor": sensor, **_walls(rng)}
    if sky:
        scene["sky"] = sky
    shapes = zoo.shapes()
    if rng.random() < 0.8:
        del shapes[NOT_RECORDED]
    if mi.variant().endswith("mono"):
        del shapes["hair"]["bsdf"]  # of RGB and spectral variants
    objects = _picked(rng, list(shapes), int(rng.integers(1, 4)))
    surfaces = []
    for i, name in enumerate(objects):
        center = rng.uniform([-0.35, -0.3, -0.3], [0.35, 0.0, 0.3])
        shape = zoo.placed(shapes[name], center.tolist(), float(rng.uniform(0.15, 0.3)))
        if name == "instance":
            material, bsdf = _material(rng, sky_name)
            box = {"type": "cube", "bsdf": bsdf}
            scene["group"] = {"type": "shapegroup", "box": box}
            surfaces.append(material)
        elif "bsdf" not in shape:
            material, shape["bsdf"] = _material(rng, sky_name)
            surfaces.append(material)
        scene[f"object_{i}"] = shape
    if sky is None and any(_lets_through(shape) for shape in scene.values()):
        sky_name, scene["sky"] = "black", BLACK
    lights = {**zoo.emitters(), "directional": edits.skies()["directional"]}
    del lights["none"]
    dark = sky_name in ("none", "black")
    chosen = _picked(rng, list(lights), int(rng.integers(1 if dark else 0, 3)))
    for i, name in enumerate(chosen):
        scene[f"light_{i}"] = zoo.moved(lights[name], *rng.uniform(-0.3, 0.3, 2).tolist())
    names = {
        "sensor": [sensor["type"]],
        "shapes": objects,
        "bsdfs": surfaces,
        "lights": chosen,
        "sky": [sky_name],
    }
    return scene, names


def _picked(rng: np.random.Generator, names: list[str], count: int) -> list[str]:
    return [str(name) for name in rng.choice(names, count, replace=False)]


def _sensor(rng: np.random.Generator) -> Scene:
    """A camera in front of the objects, sometimes of a part of its film."""
    width, height = int(rng.integers(16, 33)), int(rng.integers(16, 19))
    origin = rng.uniform([-0.8, -0.2, 1.8], [0.8, 0.8, 2.4]).tolist()
    sensor = zoo._sensor(width, height, float(rng.uniform(30, 50)), origin, [0, -0.1, 0])
    kind = str(rng.choice(["perspective", "thinlens", "orthographic"], p=[0.6, 0.25, 0.15]))
    sensor["type"] = kind
    if kind == "thinlens":
        sensor |= {"aperture_radius": float(rng.uniform(0.01, 0.1)), "focus_distance": 2.0}
    if kind == "orthographic":
        del sensor["fov"], sensor["fov_axis"]
    if kind == "perspective" and rng.random() < 0.2:
        sensor["principal_point_offset_x"] = float(rng.uniform(-0.2, 0.2))
    if rng.random() < 0.2:
        crop = {"crop_width": width - 3, "crop_height": height - 2}
        sensor["film"] |= {**crop, "crop_offset_x": 2, "crop_offset_y": 1}
    sensor["film"]["pixel_format"] = str(rng.choice(["rgb", "rgba"]))
    return sensor


def _walls(rng: np.random.Generator) -> Scene:
    """A floor, and up to two walls."""
    transform = mi.ScalarTransform4f
    places = {
        "back": transform().translate([0, 0, -0.8]),
        "left": transform().translate([-0.9, 0, 0]).rotate([0, 1, 0], 90),
        "right": transform().translate([0.9, 0, 0]).rotate([0, 1, 0], -90),
        "ceiling": transform().translate([0, 0.9, 0]).rotate([1, 0, 0], 90),
    }
    chosen = _picked(rng, list(places), int(rng.integers(0, 3)))
    places["floor"] = transform().translate([0, -0.6, 0]).rotate([1, 0, 0], -90)
    materials = zoo.bsdfs()
    return {
        name: {
            "type": "rectangle",
            "to_world": places[name],
            "bsdf": {
                "type": "twosided",
                "nested": materials[str(rng.choice(["diffuse", "textured", "roughplastic"]))],
            },
        }
        for name in ["floor", *chosen]
    }


def _sky(rng: np.random.Generator) -> tuple[str, Scene | None]:
    """An environment; also a black one, with which ``path`` keeps what null lobes let through."""
    skies = {name: edits.skies()[name] for name in ("constant", "envmap", "sunsky")}
    if mi.variant().endswith("mono"):
        del skies["sunsky"]  # of RGB and spectral variants
    skies["black"] = BLACK
    name = str(rng.choice([*skies, "none"]))
    return name, skies.get(name)


def _lets_through(plugin: Any) -> bool:
    """Whether ``path`` needs a sky to be right about it (the first limitation in README.md)."""
    if not isinstance(plugin, dict):
        return False
    if "bsdf" not in plugin:
        return any(_lets_through(part) for part in plugin.values())
    return mi.has_flag(mi.load_dict(plugin["bsdf"]).flags(), mi.BSDFFlags.Null)


def _material(rng: np.random.Generator, sky: str) -> tuple[str, Scene]:
    """A BSDF, sometimes inside another one."""
    materials = zoo.bsdfs()
    if sky == "sunsky":
        materials = {name: materials[name] for name in WITHOUT_CAUSTICS}
    name = str(rng.choice(list(materials)))
    bsdf = materials[name]
    kind = rng.random()
    if kind < 0.25 and name in OPAQUE:
        return f"twosided {name}", {"type": "twosided", "nested": bsdf}
    if kind < 0.35:
        return f"mask {name}", {"type": "mask", "opacity": float(rng.random()), "nested": bsdf}
    if kind < 0.5 and name in OPAQUE:
        other = str(rng.choice([other for other in OPAQUE if other in materials]))
        blend = {"type": "blendbsdf", "weight": float(rng.uniform(0.1, 0.9))}
        return f"{name} + {other}", {**blend, "first": bsdf, "second": materials[other]}
    return name, bsdf


# --------------------------------- parameters ---------------------------------------------------


def _parameters(rng: np.random.Generator) -> dict[str, Any]:
    def one(*values: Any) -> Any:
        return values[int(rng.integers(len(values)))]

    parameters = {
        "type": "restir_pt",
        "max_depth": one(1, 2, 3, 3, 4, 5, 8, -1),
        "rr_depth": one(2, 3, 5, 8),
        "hide_emitters": one(False, False, False, False, True),
        "temporal": one(True, True, True, False),
        "spatial": one(True, True, True, True, False),
        "spatial_neighbors": one(1, 2, 3, 5),
        "spatial_radius": one(1.0, 2.0, 6.0, 20.0),
        "spatial_rounds": one(1, 1, 2, 3),
        "neighbor_sampling": one("random", "random", "blue_noise", "white_noise", "blocks")
        if rng.random() < 0.8
        else "geometry",
        "confidence_cap": one(0.5, 1.0, 5.0, 20.0, 20.0, 100.0),
        "shift": one("hybrid", "hybrid", "hybrid", "reconnection", "random_replay"),
        "connectability": one("footprint", "footprint", "distance_roughness"),
        "retrace_history": one(False, True),
        "mutations": one(0, 0, 1, 3),
        "mutation_acceptance": "metropolis",
        "blue_noise": "none",
        "mutation_step": float(10 ** rng.uniform(-3, 0)),
        "mutation_interval": one(1, 1, 2, 4),
        "blue_noise_seeds": one(False, False, True),
        "aovs": one("", "", "albedo, sh_normal, depth", "position, motion, confidence"),
        "guiding": one(False, False, True),
        "roulette": one("throughput", "throughput", "contribution"),
        "spatial_shrink": one(1.0, 1.0, 0.6),
        "spatial_feedback": one(16, 16, 0, 1),
    }
    if rng.random() < 0.12:
        parameters |= one(*BIASED)
    return parameters
