"""Every mode reaches the known image of closed-form scenes."""

from __future__ import annotations

import mitsuba as mi
import pytest
from support import closed_form
from support.modes import MODES
from support.runs import assert_unbiased, bias_report, independent_runs, integrator

pytestmark = pytest.mark.usefixtures("one_thread")

SCENES = {
    "glowing": lambda: closed_form.glowing_box(5),
    "glowing_coloured": lambda: closed_form.glowing_box(4, coloured=True),
    "lit": lambda: closed_form.lit_sphere(5),
    "lit_coloured": lambda: closed_form.lit_sphere(-1, coloured=True),
    "furnace": closed_form.furnace,
}

# Runs and the relative error of the image that is found with probability 0.99.
RUNS = {"furnace": (320, 0.01)}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", SCENES)
def test_known_radiance(rgb, name, mode):
    case = SCENES[name]()
    scene = mi.load_dict(case.scene)
    runs, power = RUNS.get(name, (64, 0.01))
    chosen = MODES[mode]
    report = bias_report(
        independent_runs(integrator(case.max_depth, chosen), scene, chosen), runs, case.reference()
    )
    assert_unbiased(report, f"{name}-{mode}", power)
