"""Plans of stills: names, values, and what is said about those that are wrong."""

from __future__ import annotations

import re

import pytest

from mitsuba_restir.integrators.parameters import PARAMETERS
from mitsuba_restir.still.plan import PLANNED, PLANS, parse


def test_names_are_plans():
    for name, plan in PLANS.items():
        assert parse(name) is plan
        assert plan.name == name
        assert name in plan.describe()


def test_values_are_a_plan():
    plan = parse("spp=8, spatial_neighbors=6,spatial_rounds=5 ,spatial_radius=10,guiding=true")
    assert plan.spp == 8
    assert plan.parameters == {
        "spatial_neighbors": 6,
        "spatial_rounds": 5,
        "spatial_radius": 10.0,
        "guiding": True,
    }
    assert plan.mixes
    assert not parse("spatial=false").mixes


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no plan ''"),
        ("much", "no plan 'much'; use one of candidates, "),
        ("spp=8,much", "no plan 'much'"),
        ("temporal=true", "no 'temporal'"),
        ("spp=0", "spp must be an integer of at least 1"),
        ("spp=many", "spp must be an integer"),
        ("spatial=perhaps", "spatial must be true or false"),
        ("spatial_rounds=17", "spatial_rounds must be an integer from 1 to 16"),
        ("spp=8,spp=9", "spp is given twice"),
    ],
)
def test_other_words_are_refused(text, said):
    with pytest.raises(ValueError, match=re.escape(said)) as error:
        parse(text)
    assert "\n" not in str(error.value)


def test_a_plan_can_set_what_is_unbiased_and_independent():
    assert set(PLANNED) < set(PARAMETERS)
    for plan in PLANS.values():
        assert set(plan.parameters) <= set(PLANNED)
        assert plan.integrator["temporal"] is False
