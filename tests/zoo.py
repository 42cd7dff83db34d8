"""A zoo of BSDFs, emitters and shapes: few scenes, a grid of objects in each.

Compiling a scene costs more than its pixels, so a scene holds as many plugins as can be told apart:
one cell of the grid is at least 12 x 12 pixels, and the tests look at blocks of that size.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

CELL = 12

Scene = dict[str, Any]


def _sensor(width: int, height: int, fov: float, origin: Any, target: Any) -> Scene:
    return {
        "type": "perspective",
        "fov": fov,
        "fov_axis": "x",
        "to_world": mi.ScalarTransform4f().look_at(origin, target, [0, 1, 0]),
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent", "sample_count": 1},
    }


def _rgb(*value: float) -> Scene:
    return {"type": "rgb", "value": list(value)}


def _texture(values: np.ndarray, raw: bool = False) -> Scene:
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(values, dtype=np.float32)),
        "raw": raw,
        "filter_type": "bilinear",
        "wrap_mode": "repeat",
    }


def _checker(a: float, b: float, cells: int = 6) -> Scene:
    return {
        "type": "checkerboard",
        "color0": a,
        "color1": b,
        "to_uv": mi.ScalarTransform3f().scale([cells, cells]),
    }


def _bumps() -> np.ndarray:
    x = np.linspace(0, 2 * np.pi, 33)[:-1]
    return (0.5 + 0.5 * np.sin(3 * x)[:, None] * np.sin(4 * x)[None, :])[..., None]


def _normals() -> np.ndarray:
    x = np.linspace(0, 2 * np.pi, 33)[:-1]
    nx = np.broadcast_to(0.3 * np.sin(4 * x)[None, :], (32, 32))
    ny = np.broadcast_to(0.3 * np.sin(3 * x)[:, None], (32, 32))
    n = np.stack([nx, ny, np.sqrt(1 - nx**2 - ny**2)], axis=-1)
    return 0.5 * n + 0.5


# --------------------------------- BSDFs --------------------------------------------------------


def bsdfs() -> dict[str, Scene]:
    """Every BSDF that ``path`` takes in unpolarized variants and that needs no data file."""
    diffuse = {"type": "diffuse", "reflectance": _rgb(0.6, 0.5, 0.3)}
    return {
        "diffuse": diffuse,
        "textured": {"type": "diffuse", "reflectance": _checker(0.2, 0.8)},
        "roughconductor": {"type": "roughconductor", "material": "Au", "alpha": 0.3},
        "roughconductor_sharp": {"type": "roughconductor", "material": "Al", "alpha": 0.1},
        "roughconductor_aniso": {
            "type": "roughconductor",
            "material": "Cu",
            "alpha_u": 0.1,
            "alpha_v": 0.4,
            "distribution": "ggx",
        },
        "conductor": {"type": "conductor", "material": "Ag"},
        "roughdielectric": {"type": "roughdielectric", "alpha": 0.3, "int_ior": 1.5},
        "dielectric": {"type": "dielectric", "int_ior": 1.5},
        "thindielectric": {"type": "thindielectric", "int_ior": 1.5},
        "plastic": {"type": "plastic", "diffuse_reflectance": _rgb(0.2, 0.4, 0.7)},
        "roughplastic": {
            "type": "roughplastic",
            "diffuse_reflectance": _rgb(0.7, 0.2, 0.2),
            "alpha": 0.15,
        },
        "pplastic": {"type": "pplastic", "diffuse_reflectance": 0.4, "alpha": 0.2},
        "principled": {
            "type": "principled",
            "base_color": _rgb(0.8, 0.4, 0.2),
            "roughness": 0.4,
            "metallic": 0.4,
            "clearcoat": 0.5,
            "spec_tint": 0.3,
        },
        "principledthin": {
            "type": "principledthin",
            "base_color": _rgb(0.4, 0.7, 0.4),
            "roughness": 0.4,
            "spec_trans": 0.4,
            "diff_trans": 0.6,
        },
        "mask": {"type": "mask", "opacity": _checker(0.2, 0.9), "nested": diffuse},
        "twosided": {"type": "twosided", "nested": diffuse},
        "blendbsdf": {
            "type": "blendbsdf",
            "weight": _checker(0.2, 0.8),
            "first": {"type": "roughconductor", "material": "Ag", "alpha": 0.15},
            "second": diffuse,
        },
        "normalmap": {
            "type": "normalmap",
            "normalmap": _texture(_normals(), raw=True),
            "nested": {"type": "roughplastic", "alpha": 0.2},
        },
        "bumpmap": {
            "type": "bumpmap",
            "scale": 0.2,
            "arbitrary": _texture(_bumps(), raw=True),
            "nested": diffuse,
        },
        "null": {"type": "null"},
    }


def _stage() -> Scene:
    """Floor, large area light and dim sky."""
    transform = mi.ScalarTransform4f
    return {
        "sky": {"type": "constant", "radiance": 0.3},
        "light": {
            "type": "rectangle",
            "to_world": transform().look_at([2.5, 6, -2], [0, 0, 0], [0, 1, 0]).scale([2, 2, 1]),
            "emitter": {"type": "area", "radiance": _rgb(3.0, 2.7, 2.2)},
        },
        "floor": {
            "type": "rectangle",
            "to_world": transform().rotate([1, 0, 0], -90).scale([4, 4, 1]),
            "bsdf": {"type": "diffuse", "reflectance": _rgb(0.5, 0.5, 0.6)},
        },
    }


def bsdf_zoo() -> Scene:
    """Spheres of all BSDFs on a floor, under a large area light and a dim sky."""
    columns = 5
    scene: Scene = {
        "type": "scene",
        "sensor": _sensor(5 * CELL, 4 * CELL, 30.0, [0, 8.2, 5.6], [0, 0.1, 0.05]),
        **_stage(),
    }
    for i, (name, bsdf) in enumerate(bsdfs().items()):
        column, row = i % columns, i // columns
        scene[f"ball_{name}"] = {
            "type": "sphere",
            "center": [(column - 2) * 1.0, 0.45, (row - 1.5) * 1.25],
            "radius": 0.4,
            "bsdf": bsdf,
        }
    return scene


# --------------------------------- emitters -----------------------------------------------------


def emitters() -> dict[str, Scene]:
    """Local lights for a booth of side 1 around the origin, open towards +z."""
    transform = mi.ScalarTransform4f
    down = transform().translate([0, 0.45, 0]).rotate([1, 0, 0], 90)
    lens = transform().look_at([0, 0.4, 0.35], [0, -0.3, -0.3], [0, 1, 0])
    area = {"type": "area", "radiance": 8.0}
    # Not a bitmap: Dr.Jit 1.5 cannot record those on area lights (see test_frames.py).
    pattern = {**_checker(5.0, 13.0, 3)}
    return {
        "rectangle": {"type": "rectangle", "to_world": down.scale(0.2), "emitter": area},
        "mesh": {
            "type": "cube",
            "to_world": transform().translate([0, 0.3, 0]).scale(0.08),
            "face_normals": True,
            "emitter": area,
        },
        "sphere": {"type": "sphere", "center": [0, 0.25, 0], "radius": 0.12, "emitter": area},
        "disk": {"type": "disk", "to_world": down.scale(0.2), "emitter": area},
        "cylinder": {
            "type": "cylinder",
            "p0": [-0.3, 0.3, 0],
            "p1": [0.3, 0.3, 0],
            "radius": 0.05,
            "emitter": area,
        },
        "textured": {
            "type": "rectangle",
            "to_world": down.scale(0.25),
            "emitter": {
                "type": "area",
                "radiance": pattern,
            },
        },
        "point": {"type": "point", "position": [0, 0.3, 0.1], "intensity": 0.5},
        "spot": {
            "type": "spot",
            "to_world": lens,
            "intensity": 1.5,
            "cutoff_angle": 35.0,
            "beam_width": 20.0,
        },
        "projector": {
            "type": "projector",
            "irradiance": _texture(0.2 + np.random.default_rng(4).random((4, 4, 3))),
            "to_world": lens,
            "fov": 60.0,
            "scale": 0.6,
        },
        "directionalarea": {
            "type": "rectangle",
            "to_world": down.scale(0.25),
            "emitter": {"type": "directionalarea", "radiance": 1.5},
        },
        "two_lights": {
            "type": "sphere",
            "center": [-0.25, -0.25, 0.1],
            "radius": 0.1,
            "emitter": {"type": "area", "radiance": _rgb(2.0, 6.0, 2.0)},
        },
        "none": {"type": "sphere", "center": [0, -0.2, 0], "radius": 0.2},
    }


def moved(plugin: Scene, x: float, y: float) -> Scene:
    """The plugin, translated in the plane of the booths."""
    offset = mi.ScalarTransform4f().translate([x, y, 0])
    plugin = dict(plugin)
    for key in ("center", "position", "p0", "p1"):
        if key in plugin:
            p = plugin[key]
            plugin[key] = [p[0] + x, p[1] + y, p[2]]
    if "to_world" in plugin:
        plugin["to_world"] = offset @ plugin["to_world"]
    return plugin


def emitter_zoo() -> Scene:
    """A light in each of 4 x 3 booths, with a sun and a dim sky from the front."""
    transform = mi.ScalarTransform4f
    wall = {"type": "diffuse", "reflectance": _rgb(0.6, 0.55, 0.5)}
    glossy = {"type": "roughconductor", "material": "Al", "alpha": 0.25}
    scene: Scene = {
        "type": "scene",
        "sensor": _sensor(4 * CELL, 3 * CELL, 33.4, [0, 0, 7.2], [0, 0, 0]),
        "sky": {"type": "constant", "radiance": 0.02},
        "sun": {"type": "directional", "direction": [0.3, -0.4, -1], "irradiance": 0.15},
    }
    wall = {"type": "twosided", "nested": wall}
    scene["back"] = {
        "type": "rectangle",
        "to_world": transform().translate([0, 0, -0.5]).scale([2, 1.5, 1]),
        "bsdf": wall,
    }
    for i in range(5):
        scene[f"partition_{i}"] = {
            "type": "rectangle",
            "to_world": transform()
            .translate([i - 2, 0, 0])
            .rotate([0, 1, 0], 90)
            .scale([0.5, 1.5, 1]),
            "bsdf": wall,
        }
    for i in range(4):
        scene[f"shelf_{i}"] = {
            "type": "rectangle",
            "to_world": transform()
            .translate([0, i - 1.5, 0])
            .rotate([1, 0, 0], 90)
            .scale([2, 0.5, 1]),
            "bsdf": wall,
        }
    for i, (name, light) in enumerate(emitters().items()):
        x, y = i % 4 - 1.5, 1.0 - i // 4
        scene[f"light_{name}"] = moved(light, x, y)
        scene[f"ball_{name}"] = {
            "type": "sphere",
            "center": [x + 0.22, y - 0.3, -0.1],
            "radius": 0.16,
            "bsdf": glossy,
        }
    return scene


def _sky_scene(sky: Scene, fourth: str) -> Scene:
    """A few objects on a plane under an environment light."""
    transform = mi.ScalarTransform4f
    names = ["diffuse", "roughconductor", "roughconductor_sharp", fourth, "roughplastic"]
    materials = bsdfs()
    scene: Scene = {
        "type": "scene",
        "sensor": _sensor(4 * CELL, 3 * CELL, 40.0, [0, 3.5, 5.5], [0, 0.2, 0]),
        "sky": sky,
        "floor": {
            "type": "rectangle",
            "to_world": transform().rotate([1, 0, 0], -90).scale([5, 5, 1]),
            "bsdf": {"type": "diffuse", "reflectance": _rgb(0.5, 0.5, 0.6)},
        },
    }
    for i, name in enumerate(names):
        scene[f"ball_{name}"] = {
            "type": "sphere",
            "center": [(i % 3 - 1) * 1.3 + (i // 3) * 0.6, 0.5, (i // 3 - 0.5) * 1.5],
            "radius": 0.5,
            "bsdf": materials[name],
        }
    return scene


def envmap_scene() -> Scene:
    """A small environment map with a bright window."""
    rng = np.random.default_rng(5)
    values = 0.3 + 0.3 * rng.random((16, 32, 3))
    values[3:6, 8:12] += 6.0
    return _sky_scene(
        {
            "type": "envmap",
            "bitmap": mi.Bitmap(values.astype(np.float32)),
            "to_world": mi.ScalarTransform4f().rotate([0, 1, 0], 40),
        },
        "dielectric",
    )


def sunsky_scene() -> Scene:
    """Sun and sky; the sun is a tiny disk that only light sampling finds in practice."""
    return _sky_scene(
        {
            "type": "sunsky",
            "sun_direction": [0.4, 0.5, 0.6],
            "turbidity": 3.0,
            "sun_scale": 1.0,
            "sky_scale": 1.0,
            "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], -90),
        },
        "principled",  # glass would make caustics of the sun, which no path tracer finds
    )


# --------------------------------- shapes -------------------------------------------------------


def _sphere_mesh(name: str, face_normals: bool, rows: int = 8, columns: int = 14) -> mi.Mesh:
    """A unit sphere of triangles, with or without vertex normals."""
    theta = np.linspace(0, np.pi, rows + 1)
    phi = np.linspace(0, 2 * np.pi, columns + 1)
    grid_theta, grid_phi = np.meshgrid(theta, phi, indexing="ij")
    points = np.stack(
        [
            np.sin(grid_theta) * np.cos(grid_phi),
            np.cos(grid_theta),
            np.sin(grid_theta) * np.sin(grid_phi),
        ],
        axis=-1,
    ).reshape(-1, 3)
    uv = np.stack([grid_phi / (2 * np.pi), grid_theta / np.pi], axis=-1).reshape(-1, 2)
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a = (i * (columns + 1) + j).ravel()
    b = a + columns + 1
    faces = np.concatenate([np.stack([a, a + 1, b], 1), np.stack([a + 1, b + 1, b], 1)])
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(
        {"type": "twosided", "nested": {"type": "diffuse", "reflectance": _rgb(0.7, 0.5, 0.3)}}
    )
    mesh = mi.Mesh(
        name,
        len(points),
        len(faces),
        props=properties,
        has_vertex_normals=not face_normals,
        has_vertex_texcoords=True,
    )
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = points.astype(np.float32).ravel()
    parameters["vertex_texcoords"] = uv.astype(np.float32).ravel()
    if not face_normals:
        parameters["vertex_normals"] = points.astype(np.float32).ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    return mesh


def _written(mesh: mi.Mesh, name: str) -> str:
    """The mesh as a PLY file, so that a scene can transform it."""
    path = Path(tempfile.mkdtemp()) / f"{name}.ply"
    mesh.write_ply(str(path))
    return str(path)


def _curve(name: str) -> str:
    """Control points of two helices with varying radius, as Mitsuba's curve plugins read them."""
    path = Path(tempfile.mkdtemp()) / f"{name}.txt"
    lines = []
    for strand in range(2):
        for t in np.linspace(0, 1, 9):
            angle = 5 * t + np.pi * strand
            lines.append(
                f"{0.7 * np.cos(angle):.5f} {2 * t - 1:.5f} {0.7 * np.sin(angle):.5f} "
                f"{0.28 - 0.1 * t:.5f}"
            )
        lines.append("")
    path.write_text("\n".join(lines))
    return str(path)


def _distances(size: int = 12) -> np.ndarray:
    """Signed distances to a torus in the unit cube."""
    axis = np.linspace(-0.5, 0.5, size)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    return (np.hypot(np.hypot(x, z) - 0.28, y) - 0.14)[..., None].astype(np.float32)


def _ellipsoids(plugin: str) -> Scene:
    """Two crossed ellipsoids."""
    turn = np.float32(np.sqrt(0.5))
    return {
        "type": plugin,
        "centers": mi.TensorXf(np.float32([[-0.4, 0, 0], [0.4, 0, 0]])),
        "scales": mi.TensorXf(np.float32([[0.4, 0.8, 0.5], [0.5, 0.3, 0.8]])),
        "quaternions": mi.TensorXf(np.float32([[0, 0, 0, 1], [0, 0, turn, turn]])),
    }


def shapes() -> dict[str, Scene]:
    """Every shape of this Mitsuba, at the origin, about one unit in radius."""
    transform = mi.ScalarTransform4f
    return {
        "smooth_mesh": {"type": "ply", "filename": _written(_sphere_mesh("s", False), "smooth")},
        "flat_mesh": {
            "type": "ply",
            "filename": _written(_sphere_mesh("f", True), "flat"),
            "face_normals": True,
        },
        "sphere": {"type": "sphere"},
        "cube": {"type": "cube", "to_world": transform().rotate([1, 2, 0], 40).scale(0.6)},
        "cylinder": {"type": "cylinder", "p0": [-0.8, 0, 0], "p1": [0.8, 0.4, 0], "radius": 0.6},
        "disk": {"type": "disk", "to_world": transform().rotate([1, 0, 0], -50)},
        "rectangle": {"type": "rectangle", "to_world": transform().rotate([1, 1, 0], -50)},
        "instance": {
            "type": "instance",
            "to_world": transform().rotate([0, 1, 0], 30).scale([0.5, 0.7, 0.5]),
            "group": {"type": "ref", "id": "group"},
        },
        "bsplinecurve": {"type": "bsplinecurve", "filename": _curve("bspline")},
        "linearcurve": {"type": "linearcurve", "filename": _curve("linear")},
        "sdfgrid": {
            "type": "sdfgrid",
            "grid": mi.TensorXf(_distances()),
            "normals": "smooth",
            "to_world": transform().scale([2, 4, 2]).translate([-0.5, -0.5, -0.5]),
        },
        "ellipsoids": _ellipsoids("ellipsoids"),
        "ellipsoidsmesh": _ellipsoids("ellipsoidsmesh"),
        "hair": {"type": "linearcurve", "filename": _curve("hair"), "bsdf": {"type": "hair"}},
    }


def placed(shape: Scene, center: Any, size: float) -> Scene:
    """One of `shapes`, scaled and moved."""
    if shape["type"].startswith("ellipsoids"):  # they take no transformation
        centers = mi.TensorXf(size * np.array(shape["centers"]) + [center])
        scales = mi.TensorXf(0.4 * size * np.array(shape["scales"]))
        return {**shape, "centers": centers, "scales": scales}
    transform = mi.ScalarTransform4f
    place = transform().translate(center).scale(size)
    return {**shape, "to_world": place @ shape.get("to_world", transform())}


def shape_zoo(glossy: bool = False) -> Scene:
    """All shapes over a floor."""
    transform = mi.ScalarTransform4f
    nested: Scene = {"type": "diffuse", "reflectance": _rgb(0.7, 0.5, 0.3)}
    if glossy:
        nested = {"type": "roughconductor", "material": "Cu", "alpha": 0.25}
    bsdf = {"type": "twosided", "nested": nested}
    scene: Scene = {
        "type": "scene",
        "sensor": _sensor(5 * CELL, 3 * CELL, 41.0, [0, 9, 5.0], [0, 0, 0.1]),
        **_stage(),
        "group": {
            "type": "shapegroup",
            "box": {"type": "cube", "bsdf": bsdf},
            "ball": {
                "type": "ply",
                "filename": _written(_sphere_mesh("g", False), "group"),
                "to_world": transform().translate([0, 1, 0]),
                "bsdf": bsdf,
            },
        },
    }
    for i, (name, shape) in enumerate(shapes().items()):
        x, z = (i % 5 - 2) * 1.35, (i // 5 - 1) * 1.5
        shape = placed(shape, [x, 0.55, z], 0.5)
        if shape["type"] != "instance":
            shape.setdefault("bsdf", bsdf)
        scene[f"shape_{name}"] = shape
    return scene


SCENES: dict[str, Callable[[], Scene]] = {
    "bsdfs": bsdf_zoo,
    "emitters": emitter_zoo,
    "envmap": envmap_scene,
    "sunsky": sunsky_scene,
    "shapes": shape_zoo,
    "glossy_shapes": lambda: shape_zoo(glossy=True),
}
