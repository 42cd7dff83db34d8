"""Selection shows estimates of the frame; nothing of it reaches the reservoirs."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats
from support import references

from mitsuba_restir.paths.vertex import Vertex, exists

FRAMES = 4
SAMPLING = ("random", "blue_noise")


def render(
    blue_noise: str,
    sampling: str = "random",
    frames: int = FRAMES,
    first: int = 0,
    scene: mi.Scene | None = None,
) -> tuple[np.ndarray, Any]:
    scene = scene or references.CASES["room"].load()
    parameters = {"blue_noise": blue_noise, "neighbor_sampling": sampling, "mutations": 2}
    integrator = mi.load_dict({"type": "restir_pt", "max_depth": 5, **parameters})
    images = [integrator.render(scene, seed=first + t, spp=1) for t in range(frames)]
    return np.stack([np.array(image)[..., :3] for image in images]), integrator


def words(value: Any) -> list[np.ndarray]:
    """All numbers of a structure of arrays that mean something."""
    if is_dataclass(value):
        found = [word for field in fields(value) for word in words(getattr(value, field.name))]
        if isinstance(value, Vertex):  # what a ray that escapes leaves in it is random
            found = [np.where(np.array(exists(value)), word, 0) for word in found]
        return found
    if isinstance(value, mi.ShapePtr):
        value = dr.reinterpret_array(mi.UInt32, value)
    return [np.array(value)]


@pytest.mark.parametrize("sampling", SAMPLING)
def test_history_is_the_same_with_and_without(rgb, sampling):
    scene = references.CASES["room"].load()
    own, other = (render(b, sampling, scene=scene)[1]._history for b in ("none", "selection"))
    compared = zip(words(own.reservoirs), words(other.reservoirs), strict=True)
    for a, b in [*compared, *zip(words(own.hits), words(other.hits), strict=True)]:
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("sampling", SAMPLING)
def test_equal_seeds_give_equal_images(rgb, sampling):
    np.testing.assert_array_equal(
        render("selection", sampling)[0], render("selection", sampling)[0]
    )


@pytest.mark.parametrize("sampling", SAMPLING)
def test_it_chooses_and_keeps_the_mean(rgb, sampling):
    """Bias below 1.5 % with Student's interval at 99 % of 8 paired runs."""
    pairs = [
        [render(blue_noise, sampling, 12, 20 * run)[0] for blue_noise in ("none", "selection")]
        for run in range(8)
    ]
    assert all(not np.array_equal(a[-1], b[-1]) for a, b in pairs)
    bias = np.array([b[4:].mean() / a[4:].mean() - 1 for a, b in pairs])
    reach = stats.t.ppf(0.995, len(bias) - 1) * bias.std(ddof=1) / np.sqrt(len(bias))
    print(f"{sampling}: {100 * bias.mean():.2f} +- {100 * reach:.2f} %")
    assert abs(bias.mean()) + reach < 0.015


@pytest.mark.parametrize("missing", ["spatial", "temporal"])
def test_reuse_is_needed(rgb, missing):
    with pytest.raises((ValueError, RuntimeError), match=missing):
        mi.load_dict({"type": "restir_pt", "blue_noise": "selection", missing: False})


def test_it_is_named_biased(rgb):
    assert "selection" in str(render("selection")[1].statistics()["biased"])
