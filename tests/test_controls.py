"""Tests of the tests: with a piece of the method left out, the statistical tests must fail.

Each control names what is left out and the test that sees it: the image of a mode, or the transport
identity between pixels at a fixed offset. ``test_sound`` shows that the same test, with the same
number of runs, passes when nothing is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from support import references
from support.bias import BiasReport
from support.modes import MODES
from support.mutants import Mutation, apply
from support.runs import bias_report, independent_runs, integrator
from support.transport import transport_report

pytestmark = pytest.mark.usefixtures("one_thread")


@dataclass(frozen=True)
class Control:
    mutations: tuple[Mutation, ...]
    scene: str
    test: str | tuple[int, int]
    runs: int = 256


CONTROLS = {
    "jacobian is one": Control(
        (
            Mutation(
                "dr.select(defined, jacobian, 1)",
                "mi.Float(1)",
            ),
        ),
        "far_room",
        (5, 0),
        256,
    ),
    "geometry term": Control(
        (
            Mutation(
                "start.pdf * dr.select(valid, cos_end / distance2, 1.0)",
                "dr.select(start.pdf * cos_end > 0, start.pdf, 0)",
            ),
        ),
        "far_room",
        (5, 0),
        256,
    ),
    "pdf at the vertex before reconnection": Control(
        (
            Mutation(
                "start.pdf * dr.select(valid, cos_end / distance2, 1.0)",
                "dr.select(start.pdf > 0, dr.select(valid, cos_end / distance2, 1.0), 0)",
            ),
        ),
        "far_room",
        (5, 0),
        256,
    ),
    "pdf at the reconnection vertex": Control(
        (
            Mutation("dr.select(sampled, pdf_k, 1)", "1"),
            Mutation(
                "place.arrival.area_pdf * bounce.pdf",
                "mi.Float(place.arrival.area_pdf)",
            ),
        ),
        "open_room",
        (0, 4),
        512,
    ),
    "pairwise weight of the neighbour": Control(
        (
            Mutation(
                "m_other * shifted.jacobian",
                "shifted.jacobian",
            ),
        ),
        "room",
        "spatial_1",
        128,
    ),
    "pairwise weight of the canonical sample": Control(
        (
            Mutation(
                "dr.select(theirs.valid, canonical_share(sharing, reservoirs, reach), 0)",
                "dr.select(theirs.valid, mi.Float(1), 0)",
            ),
        ),
        "room",
        "spatial_1",
        128,
    ),
    "temporal weight of the history": Control(
        (
            Mutation(
                "m_history * target(forward.color)",
                "target(forward.color)",
            ),
        ),
        "room",
        "temporal",
        64,
    ),
    "balance of light and BSDF sampling": Control(
        (Mutation("balance(light_pdf, scatter_pdf)", "1"),),
        "room",
        "candidates_4",
        128,
    ),
    "balance at a shifted light": Control(
        (Mutation("e.emitted * balance(e.pdf, e.emitted_pdf)", "e.emitted"),),
        "room",
        (0, 4),
        1024,
    ),
    "visibility of the reconnection": Control(
        (Mutation("dr.select(occluded, Outcome.OCCLUDED, outcome)", "outcome"),),
        "room",
        (0, 4),
        256,
    ),
    "invertibility of the replay": Control(
        (
            Mutation(
                "connectable = ~bounce.delta & (bounce.pdf <= arrival.limit)",
                "connectable = mi.Bool(False)",
            ),
        ),
        "far_room",
        (5, 0),
        1024,
    ),
    "invertibility at the head": Control(
        (
            Mutation(
                "dr.select(by_hit, arrival.reaches, pdf <= arrival.limit)",
                "by_hit & arrival.reaches",
            ),
        ),
        "far_room",
        (0, 4),
        256,
    ),
    "connectability of the new pair": Control(
        (Mutation("(outcome == Outcome.OK) & ~fits", "mi.Bool(False)"),),
        "far_room",
        (5, 0),
        256,
    ),
    "roulette": Control(
        (
            Mutation(
                "survival *= chance",
                "survival = mi.Float(survival)",
            ),
        ),
        "room_unlimited",
        "candidates_4",
        256,
    ),
}


def report(control: Control) -> BiasReport:
    case = references.CASES[control.scene]
    reference, variance = references.load(control.scene)
    if isinstance(control.test, tuple):
        return transport_report(case, control.test, control.runs, reference)
    mode = MODES[control.test]
    renderer = integrator(case.max_depth, mode, hide_emitters=case.hide_emitters)
    runs = independent_runs(renderer, case.load(), mode)
    return bias_report(runs, control.runs, reference, variance)


@pytest.mark.parametrize("name", CONTROLS)
def test_control(rgb, monkeypatch, name):
    control = CONTROLS[name]
    apply(monkeypatch, control.mutations)
    result = report(control)
    print(f"{name}: {result}")
    assert not result.passed, f"{name} is left out, and nothing is seen\n{result}"


@pytest.mark.parametrize(
    "control",
    {(c.scene, c.test, c.runs): c for c in CONTROLS.values()}.values(),
    ids=lambda c: f"{c.scene}-{c.test}-{c.runs}",
)
def test_sound(rgb, control):
    result = report(control)
    assert result.passed, f"{control.scene}, {control.test}\n{result}"
