"""The campaign of ``python -m tests.breaking``: scenes are varied, it finds, it loses nothing."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import mitsuba as mi
import pytest
import zoo
from support.mutants import Mutation, apply

from tests.breaking import campaign, pixels, trial
from tests.breaking.generator import combination

SOUND = (1, 4)
"""Seeds that are quick."""

WITH_JACOBIANS = (1, 11)
"""Seeds with reconnections whose Jacobians are far from one, and little noise."""


@pytest.fixture(autouse=True)
def variant_kept(rgb):
    yield
    mi.set_variant("llvm_ad_rgb")


def test_scenes_are_valid_and_varied():
    made: dict[str, set[str]] = defaultdict(set)
    values: dict[str, set[Any]] = defaultdict(set)
    for seed in range(120):
        chosen = combination(seed)
        made["variant"].add(chosen.variant)
        for kind, names in chosen.names.items():
            made[kind] |= {part for name in names for part in name.replace(" + ", " ").split()}
        for name, value in chosen.parameters.items():
            values[name].add(value)
        if seed % 10 == 0:
            scene = mi.load_dict(chosen.scene)
            assert 2 <= len(scene.shapes()) <= 12
            mi.load_dict(chosen.parameters)
    print({kind: len(names) for kind, names in made.items()})
    mi.set_variant("llvm_ad_rgb")
    assert made["variant"] == {"llvm_ad_rgb", "llvm_ad_mono"}
    assert made["shapes"] == set(zoo.shapes())
    assert made["bsdfs"] >= set(zoo.bsdfs())
    assert made["lights"] == {*zoo.emitters(), "directional"} - {"none"}
    assert made["sky"] == {"constant", "envmap", "sunsky", "black", "none"}
    assert made["sensor"] == {"perspective", "thinlens", "orthographic"}
    assert {name for name, seen in values.items() if len(seen) == 1} == {"type"}


def test_a_seed_is_the_same_every_time():
    one, again, other = combination(5), combination(5), combination(6)
    assert (one.parameters, one.names) == (again.parameters, again.names)
    assert (one.parameters, one.names) != (other.parameters, other.names)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SOUND)
def test_a_seed_from_end_to_end(seed):
    result = trial.run(seed, 200)
    print(result)
    assert not result.failures
    assert result.edited
    assert result.yardstick == "path"
    assert result.finds is not None


@pytest.mark.slow
def test_pixels_are_counted():
    (count,) = pixels.counts(pixels.SIDE**2 + 1, SOUND[0])
    assert count.pixels == 2 * pixels.SIDE**2
    assert count.bad == count.history == count.refused == 0


@pytest.mark.long
def test_a_missing_jacobian_is_found(monkeypatch):
    """The control: the same seeds pass when nothing is left out."""
    assert not any(trial.run(seed, 200).failures for seed in WITH_JACOBIANS)
    apply(monkeypatch, (Mutation("dr.select(defined, jacobian, 1)", "mi.Float(1)"),))
    found = [list(trial.run(seed, 200).failures) for seed in WITH_JACOBIANS]
    print(found)
    assert ["biased"] in found


# --------------------------------- the campaign around the seeds --------------------------------

CHILD = """
import os, sys, time
seed = int(sys.argv[1])
if seed == 1:
    os.abort()
if seed == 2:
    time.sleep(60)
print('{"seed": %d, "failures": {}}' % seed)
"""


@pytest.fixture
def quick(tmp_path, monkeypatch) -> campaign.Campaign:
    """A campaign whose seeds end well, but for one that crashes and one that hangs."""
    child = tmp_path / "child.py"
    child.write_text(CHILD)
    monkeypatch.setattr(campaign.Campaign, "command", lambda self, seed: [str(child), str(seed)])
    return campaign.Campaign(seeds=4, first=0, jobs=2, timeout=5.0, out=tmp_path / "out")


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_a_crash_and_a_hang_are_findings(quick):
    reported: list[int] = []
    records = campaign.run(quick, lambda record: reported.append(record["seed"]))
    kinds = {seed: list(record["failures"]) for seed, record in records.items()}
    assert kinds == {0: [], 1: ["crash"], 2: ["hang"], 3: []}
    assert sorted(reported) == [0, 1, 2, 3]
    assert {record["seed"]: record for record in lines(quick.results)} == records


def test_a_campaign_goes_on_where_it_was_ended(quick):
    quick.out.mkdir()
    done = [{"seed": seed, "failures": {}, "seeds": 4, "seconds": 1.0} for seed in (1, 2)]
    other = {"seed": 3, "failures": {}, "seeds": 200, "seconds": 1.0}
    whole = "\n".join(json.dumps(record) for record in [*done, other])
    quick.results.write_text(whole + '\n{"seed": 0, "fail')
    reported: list[int] = []
    records = campaign.run(quick, lambda record: reported.append(record["seed"]))
    assert sorted(reported) == [0, 3]
    assert [records[1], records[2]] == done
    assert campaign.known(quick) == records


def test_what_is_done_survives_an_interrupt(quick):
    def interrupt(record: dict[str, Any]) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        campaign.run(quick, interrupt)
    assert len(campaign.known(quick)) == 1
