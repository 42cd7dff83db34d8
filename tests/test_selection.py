"""Selection shows estimates of the frame; nothing of it reaches the reservoirs."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from support import references

FRAMES = 4


def render(blue_noise: str, frames: int = FRAMES, first: int = 0) -> tuple[np.ndarray, Any]:
    scene = references.CASES["room"].load()
    integrator = mi.load_dict({"type": "restir_pt", "max_depth": 5, "blue_noise": blue_noise})
    images = [integrator.render(scene, seed=first + t, spp=1) for t in range(frames)]
    return np.stack([np.array(image)[..., :3] for image in images]), integrator


def words(reservoirs: Any) -> list[np.ndarray]:
    """All numbers of the reservoirs."""
    record, numbers = reservoirs.path, [reservoirs.weight, reservoirs.confidence]
    numbers += [*reservoirs.color, record.jacobian, record.light_pdf, record.info, record.pixel]
    return [np.array(number) for number in numbers]


def test_reservoirs_are_the_same_with_and_without(rgb):
    (_, plain), (_, selecting) = render("none"), render("selection")
    for own, other in zip(
        words(plain._history.reservoirs), words(selecting._history.reservoirs), strict=True
    ):
        np.testing.assert_array_equal(own, other)


def test_equal_seeds_give_equal_images(rgb):
    np.testing.assert_array_equal(render("selection")[0], render("selection")[0])


def test_it_chooses_and_keeps_the_mean(rgb):
    """Paired runs: 3 standard errors of the difference, or 1 % (false alarms: 1 in 370)."""
    pairs = [
        (render("none", 12, 20 * run)[0], render("selection", 12, 20 * run)[0]) for run in range(6)
    ]
    shown = np.array([(b[8:].mean() - a[8:].mean()) / a[8:].mean() for a, b in pairs])
    assert all(not np.array_equal(a[-1], b[-1]) for a, b in pairs)
    assert abs(shown.mean()) < max(0.01, 3 * shown.std(ddof=1) / np.sqrt(len(shown)))


def test_spatial_reuse_is_needed(rgb):
    with pytest.raises((ValueError, RuntimeError), match="spatial"):
        mi.load_dict({"type": "restir_pt", "blue_noise": "selection", "spatial": False})


def test_it_is_named_biased(rgb):
    assert "selection" in str(render("selection")[1].statistics()["biased"])
    assert dr.width(render("selection", 1)[1]._history.reservoirs.weight) > 1
