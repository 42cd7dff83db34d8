"""Scenes from the world outside render by their XML file, where MITSUBA_RESTIR_SCENES is set."""

from __future__ import annotations

import os
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

FOLDER = os.environ.get("MITSUBA_RESTIR_SCENES")


@pytest.mark.skipif(FOLDER is None, reason="MITSUBA_RESTIR_SCENES is not set")
@pytest.mark.filterwarnings("ignore:restir_pt. the film's reconstruction filter")
@pytest.mark.parametrize("name", ["veach-ajar", "staircase2"])
def test_scene_renders(rgb, name):
    scene = mi.load_file(str(Path(FOLDER) / name / "scene.xml"), resx=64, resy=36, max_depth=6)
    integrator = mi.load_dict({"type": "restir_pt", "max_depth": 6, "mutations": 1})
    for seed in range(4):
        image = np.array(mi.render(scene, integrator=integrator, spp=1, seed=seed))
        assert np.isfinite(image).all()
        assert image.min() >= 0
    assert image.mean() > 0.1
    statistics = integrator.statistics()
    assert statistics["matched"] > 0.8
    assert statistics["temporal"]["ok"] > 0.9
    assert statistics["spatial_0"]["ok"] > 0.6
