"""The embedded scenes: they load in every colour mode, and what they promise holds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir import scenes
from mitsuba_restir.scenes import ajar, furniture, textures, vessels
from mitsuba_restir.scenes.geometry import Geometry, fillet, merge, spline
from mitsuba_restir.scenes.noise import hash01
from mitsuba_restir.scenes.solids import box, lathe, moulding, pillow, tube

NAMES = ["ajar", "cornell", "gloss", "court"]


@pytest.fixture
def variant(request: pytest.FixtureRequest) -> Iterator[str]:
    """Switch to the variant of the test's parameter and back."""
    before = mi.variant()
    mi.set_variant(request.param)
    yield request.param
    mi.set_variant(before or "llvm_ad_rgb")


def image(scene: Any, spp: int) -> np.ndarray:
    return np.array(mi.render(scene, spp=spp, seed=1))


def test_lights_come_in_their_order(rgb: None) -> None:
    """Merged shapes would come in an order of addresses."""
    shapes = scenes.load("gloss", 8, 8).shapes()
    described = scenes.as_dict("gloss")
    lights = [shape.id() for shape in shapes if shape.is_emitter()]
    assert len(lights) == 3
    assert lights == [key for key in described if key in lights]


def test_names_and_errors() -> None:
    assert set(NAMES) <= set(scenes.names())
    for name in scenes.names():
        text = scenes.describe(name)
        assert text
        assert "\n" not in text
    with pytest.raises(ValueError, match=r"unknown scene 'nowhere': choose one of ajar, "):
        scenes.load("nowhere")
    with pytest.raises(ValueError, match="0x9"):
        scenes.as_dict("cornell", 0, 9)


@pytest.mark.parametrize("variant", ["llvm_ad_rgb"], indirect=True)
@pytest.mark.parametrize("name", NAMES)
def test_renders(variant: str, name: str) -> None:
    scene = scenes.load(name, width=32, height=18)
    pixels = image(scene, 8)
    assert pixels.shape == (18, 32, 3)
    assert np.isfinite(pixels).all()
    assert pixels.min() >= 0.0
    # Exposed for direct display: the middle of the histogram is neither black nor white.
    assert 0.01 < np.median(image(scene, 64)) < 0.6


@pytest.mark.parametrize("variant", ["llvm_ad_mono", "llvm_ad_spectral"], indirect=True)
def test_other_colour_modes(variant: str) -> None:
    for name in NAMES:
        scene = scenes.load(name, width=16, height=9)
        if name in ("gloss", "court"):
            pixels = image(scene, 4)
            assert np.isfinite(pixels).all()
            assert pixels.mean() > 0.01


def door_replaced(plug: bool) -> dict[str, Any]:
    """`ajar` without its door, the doorway open or filled."""
    content = scenes.as_dict("ajar", 48, 27)
    del content["door_leaf"], content["door_handle"]
    if plug:
        centre = [0.5 * (ajar.DOOR_LEFT + ajar.DOOR_RIGHT), 0.5 * ajar.DOOR_TOP, -0.5 * ajar.WALL]
        half = [0.5 * (ajar.DOOR_RIGHT - ajar.DOOR_LEFT), 0.5 * ajar.DOOR_TOP, 0.5 * ajar.WALL]
        to_world = mi.ScalarTransform4f().translate(centre).scale([1.001 * h for h in half])
        content["plug"] = {"type": "cube", "to_world": to_world}
    return content


@pytest.mark.parametrize("variant", ["llvm_ad_rgb"], indirect=True)
def test_ajar_is_lit_through_the_door_only(variant: str) -> None:
    closed = image(mi.load_dict(door_replaced(plug=True)), 64)
    assert closed.max() == 0.0
    opened = image(mi.load_dict(door_replaced(plug=False)), 16)
    assert opened.mean() > 0.05


@pytest.mark.parametrize("variant", ["llvm_ad_rgb"], indirect=True)
def test_ajar_is_mostly_indirect(variant: str) -> None:
    content = scenes.as_dict("ajar", 96, 54)
    content["integrator"]["max_depth"] = 2
    direct = image(mi.load_dict(content), 16)
    assert (direct.sum(axis=2) == 0.0).mean() > 0.8
    assert (direct.sum(axis=2) > 0.0).mean() > 0.02


@pytest.mark.parametrize("variant", ["llvm_ad_rgb"], indirect=True)
@pytest.mark.parametrize("name", NAMES)
def test_lights_have_no_vertex_normals(variant: str, name: str) -> None:
    scene = scenes.load(name, width=16, height=9)
    for emitter in scene.emitters():
        shape = emitter.get_shape()
        if shape is not None:
            assert not isinstance(shape, mi.Mesh) or not shape.has_vertex_normals()


@pytest.mark.parametrize("variant", ["llvm_ad_rgb"], indirect=True)
@pytest.mark.parametrize("name", NAMES)
def test_geometry_repeats(variant: str, name: str) -> None:
    first, second = (scenes.as_dict(name, 16, 9) for _ in range(2))
    assert list(first) == list(second)
    triangles = 0
    for key, value in first.items():
        if isinstance(value, mi.Mesh):
            a, b = mi.traverse(value), mi.traverse(second[key])
            for field in ("faces", "vertex_positions", "vertex_normals", "vertex_texcoords"):
                assert np.array_equal(np.array(a[field]), np.array(b[field])), (key, field)
            normals = np.array(a["vertex_normals"])
            assert np.allclose(np.linalg.norm(normals.reshape(-1, 3), axis=1), 1.0, atol=1e-4)
            triangles += value.face_count()
    assert triangles < 100_000


def test_textures_repeat() -> None:
    values = (hash01([0, 1, 2], 5, 7) * 2**32).astype(np.uint64)
    assert values.tolist() == [1860184621, 1907390417, 2973559059]
    for make in (textures.veneer, textures.rug):
        assert np.array_equal(make(), make())


def is_closed(geometry: Geometry) -> bool:
    """Each edge is met once in each direction, and the enclosed volume is positive."""
    key = np.unique(np.round(geometry.positions, 7), axis=0, return_inverse=True)[1].ravel()
    f = key[geometry.faces]
    edges = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    forward, backward = (
        np.unique(e[:, 0] * len(key) + e[:, 1], return_counts=True) for e in (edges, edges[:, ::-1])
    )
    a, b, c = (geometry.positions[geometry.faces[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    return bool(
        all(np.array_equal(x, y) for x, y in zip(forward, backward, strict=True)) and volume > 0
    )


def normals_agree(geometry: Geometry) -> bool:
    """Shading normals and winding point to the same side."""
    a, b, c = (geometry.positions[geometry.faces[:, k]] for k in range(3))
    shading = geometry.normals[geometry.faces].mean(axis=1)
    return bool((np.einsum("ij,ij->i", np.cross(b - a, c - a), shading) > 0).all())


def test_solids_are_closed_and_outward() -> None:
    cylinder = fillet([(0, 0), (0.5, 0, 0.05), (0.5, 1, 0.1), (0, 1)])
    solids = {
        "sharp box": box((1, 2, 3)),
        "box": box((1, 2, 3), 0.1),
        "pillow": pillow((1, 2, 1), 3.0),
        "lathe": lathe(cylinder),
        "vessel": lathe(vessels.vessel([(0.3, 0), (0.5, 0.3), (0.4, 1)], 0.02)),
        "tube": tube(spline([(0, 0, 0), (0, 1, 0), (1, 1.5, 0)]), 0.1),
    }
    for name, solid in solids.items():
        assert is_closed(solid), name
        assert normals_agree(solid), name
    profile = [(0.05, 0.0), (0.05, 0.02), (0.0, 0.03), (0.0, 0.0)]
    for plane in ("xy", "zx"):
        frame = moulding([(-1, -1), (1, -1), (1, 1), (-1, 1)], profile, plane)  # type: ignore[arg-type]
        assert normals_agree(frame)


@pytest.mark.parametrize(
    "make",
    [
        lambda: furniture.sideboard(1.9, 0.8, 0.44),
        lambda: furniture.framed_picture(0.8, 0.5),
        furniture.table_lamp,
        lambda: vessels.bowl("m"),
        lambda: vessels.vase("m"),
        lambda: vessels.branches(0.7, 0.3),
        vessels.decanter,
        furniture.stool,
        lambda: vessels.cup("m"),
        lambda: vessels.teapot("m"),
        lambda: vessels.tray("m"),
        lambda: vessels.amphora("m"),
        ajar.door,
        ajar.joinery,
    ],
)
def test_furniture_faces_outward(make: Any) -> None:
    geometry = merge(part for _, part in make())
    assert normals_agree(geometry)
    assert np.isfinite(geometry.positions).all()
