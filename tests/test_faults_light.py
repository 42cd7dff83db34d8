"""Light that hostile scenes lost or invented: tiny and distant scenes, masks, values not finite.

Each test is for a wrong picture that was once rendered without a word.
"""

from __future__ import annotations

import pytest
from support import references
from support.modes import Mode
from support.mutants import Mutation, apply
from support.runs import assert_unbiased
from support.stationarity import stationarity_report
from support.transport import transport_report
from test_unbiased import check

# --------------------------------- the offset of rays -------------------------------------------

CORNERS = ["corner_small", "corner_away"]

ROUNDS = Mode({"spatial_rounds": 5, "spatial_radius": 6.0}, frames=3)
SHIFTS = {
    "hybrid": {},
    "distance": {"connectability": "distance_roughness"},
    "reconnection": {"shift": "reconnection"},
    "replay": {"shift": "random_replay"},
}

ON_THE_SURFACE = (Mutation("si.spawn_ray_to(vertex.p).o", "si.p"),)
"""A reconnection that starts where no traced ray does."""


def transport(name: str, shift: str, runs: int = 512):
    reference, _ = references.load(name)
    case = references.CASES[name]
    return transport_report(case, (0, 5), runs, reference, **SHIFTS[shift])


def stationarity(name: str):
    reference, _ = references.load(name)
    return stationarity_report(references.CASES[name], (0, 5), 512, reference, 3, 0.05)


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize("name", CORNERS)
def test_transport_in_corners(rgb, name, shift):
    """Directions, distances and visibility are those of rays that start off their surface."""
    assert_unbiased(transport(name, shift), f"transport-{name}-{shift}", 0.01)


@pytest.mark.parametrize("mode", ["candidates_4", "temporal", "both", "rounds"])
@pytest.mark.parametrize("name", CORNERS)
def test_image_of_corners(rgb, name, mode):
    chosen = ROUNDS if mode == "rounds" else mode
    check(name, chosen, 256, 0.02, label=f"{name}-{mode}")


@pytest.mark.parametrize("name", CORNERS)
def test_mutations_in_corners(rgb, name):
    assert_unbiased(stationarity(name), f"stationarity-{name}", 0.01)


@pytest.mark.parametrize("name", CORNERS)
def test_a_connection_on_the_surface_is_seen(rgb, monkeypatch, name):
    """The control of the tests above."""
    apply(monkeypatch, ON_THE_SURFACE)
    assert not transport(name, "hybrid", 256).passed
    assert not stationarity(name).passed
