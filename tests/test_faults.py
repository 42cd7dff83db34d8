"""What once gave a wrong picture, lost work or a traceback, group by group."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

# ------------------------------ words of the plugin ---------------------------------------------


def tiny() -> mi.Scene:
    film = {"type": "hdrfilm", "width": 4, "height": 4, "rfilter": {"type": "box"}}
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": {"type": "perspective", "film": film},
            "light": {"type": "constant"},
        }
    )


@pytest.mark.parametrize("seed", [-1, 2**32, 1.5, True, "3", None])
def test_a_seed_that_is_none_is_named(rgb, seed):
    renderer = mi.load_dict({"type": "restir_pt"})
    allowed = f"restir_pt: seed must be an integer from 0 to 4294967295, not {seed!r}"
    with pytest.raises(ValueError, match=allowed):
        renderer.render(tiny(), seed=seed, spp=1)


def test_a_seed_for_every_pixel_is_none(rgb):
    renderer = mi.load_dict({"type": "restir_pt"})
    with pytest.raises(ValueError, match="seed must be a single integer, not an array of 3"):
        renderer.render(tiny(), seed=mi.UInt32([1, 2, 3]), spp=1)


@pytest.mark.parametrize("spp", [-1, 2**32, 1.5, True, "3", None])
def test_an_spp_that_is_none_is_named(rgb, spp):
    renderer = mi.load_dict({"type": "restir_pt"})
    allowed = f"restir_pt: spp must be an integer from 0 to 4294967295, not {spp!r}"
    with pytest.raises(ValueError, match=allowed):
        renderer.render(tiny(), spp=spp)


def test_seeds_and_spp_of_every_integer_type_are_the_same(rgb):
    images = []
    for seed, spp in ((7, 2), (np.int64(7), np.uint8(2)), (mi.UInt32(7), 2), (mi.Int32(7), 2)):
        renderer = mi.load_dict({"type": "restir_pt"})
        images.append(np.array(renderer.render(tiny(), seed=seed, spp=spp)))
    for image in images[1:]:
        np.testing.assert_array_equal(image, images[0])
    mi.load_dict({"type": "restir_pt"}).render(tiny(), seed=2**32 - 1, spp=np.int64(0))


def test_the_number_of_samples_may_run_over(rgb):
    """Streams are named by 32 bits; a very long animation starts them again."""
    renderer = mi.load_dict({"type": "restir_pt"})
    scene = tiny()
    renderer.render(scene, spp=1)
    renderer._sample = 2**32 - 1
    images = [np.array(renderer.render(scene, spp=1)) for _ in range(2)]
    assert np.isfinite(images).all()


def test_an_integrator_of_another_variant_is_named(rgb):
    renderer, scene = mi.load_dict({"type": "restir_pt"}), tiny()
    renderer.render(scene, spp=1)
    try:
        mi.set_variant("llvm_ad_mono")
        other = tiny()
        for given in (scene, other):
            with pytest.raises(ValueError, match=r"made under llvm_ad_rgb.* now llvm_ad_mono"):
                renderer.render(given, spp=1)
        own = mi.load_dict({"type": "restir_pt"})
        with pytest.raises(ValueError, match=r"scene.* another variant than llvm_ad_mono"):
            own.render(scene, spp=1)
        with pytest.raises(ValueError, match=r"sensor.* another variant than llvm_ad_mono"):
            own.render(other, sensor=scene.sensors()[0], spp=1)
        assert own.render(other, spp=1).shape == (4, 4, 1)
    finally:
        mi.set_variant("llvm_ad_rgb")
    assert renderer.render(scene, spp=1).shape == (4, 4, 3)


@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, pickle.dumps], ids=["copy", "deepcopy", "pickle"]
)
def test_an_integrator_is_not_copied(rgb, duplicate: Callable[[Any], Any]):
    renderer = mi.load_dict({"type": "restir_pt"})
    with pytest.raises(TypeError, match=r"restir_pt: .* make another one with mi.load_dict"):
        duplicate(renderer)
