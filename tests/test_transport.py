"""Every shift carries each pixel's integral to its neighbours, for each kind of path."""

from __future__ import annotations

import pytest
from support import references
from support.runs import assert_unbiased
from support.transport import transport_report

pytestmark = pytest.mark.usefixtures("one_thread")

SHIFTS = {
    "hybrid": {},
    "distance": {"connectability": "distance_roughness"},
    "reconnection": {"shift": "reconnection"},
    "replay": {"shift": "random_replay"},
}


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize(
    ("name", "offset", "power"),
    [
        ("far_room", (5, 0), 0.005),
        ("far_room", (0, 4), 0.005),
        ("room", (0, 4), 0.01),
        ("grooves", (0, 5), 0.01),
    ],
)
def test_room(rgb, name, offset, power, shift):
    case = references.CASES[name]
    reference, _ = references.load(name)
    report = transport_report(case, offset, 512, reference, **SHIFTS[shift])
    assert_unbiased(report, f"transport-{name}-{shift}", power)


@pytest.mark.parametrize("shift", ["hybrid", "distance"])
@pytest.mark.parametrize(
    "name", ["bsdfs", "emitters", "envmap", "sunsky", "shapes", "glossy_shapes"]
)
def test_zoo(rgb, name, shift):
    case = references.CASES[name]
    reference, _ = references.load(name)
    report = transport_report(case, (3, 2), 256, reference, **SHIFTS[shift])
    assert_unbiased(report, f"transport-{name}-{shift}", 0.02)
