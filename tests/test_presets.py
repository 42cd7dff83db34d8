"""Presets: what they set, what wins over them, and that their images are right."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import mitsuba as mi
import pytest
from support import references
from support.modes import Mode
from support.runs import assert_unbiased, bias_report, independent_runs, integrator

from mitsuba_restir import cli
from mitsuba_restir.cli import denoising, loading
from mitsuba_restir.integrators import presets
from mitsuba_restir.integrators.parameters import PARAMETERS, Parameters
from mitsuba_restir.integrators.presets import PRESETS, in_words

NAMED = [name for name in PRESETS if name != "none"]
RUNS, POWER = 256, 0.025


def parameters_of(**given: Any) -> Parameters:
    return mi.load_dict({"type": "restir_pt", **given}).parameters


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_sets_what_it_says_and_leaves_the_rest(rgb, name):
    defaults = asdict(Parameters())
    assert asdict(parameters_of(preset=name)) == {**defaults, **PRESETS[name], "preset": name}


def test_no_preset_is_the_defaults(rgb):
    assert parameters_of() == parameters_of(preset="none") == Parameters()


@pytest.mark.parametrize("name", PRESETS)
def test_values_are_declared_allowed_and_no_defaults(name):
    assert "preset" not in PRESETS[name]
    for parameter, value in PRESETS[name].items():
        assert PARAMETERS[parameter].check(value) == value
        assert type(value) is PARAMETERS[parameter].kind
        assert value != PARAMETERS[parameter].default


@pytest.mark.parametrize("name", NAMED)
def test_explicit_parameters_win(rgb, name):
    """Also where they are the defaults."""
    for parameter in PRESETS[name]:
        default = PARAMETERS[parameter].default
        chosen = asdict(parameters_of(preset=name, **{parameter: default}))
        expected = {**asdict(Parameters()), **PRESETS[name], "preset": name, parameter: default}
        assert chosen == expected


@pytest.mark.parametrize("name", NAMED)
def test_text_and_reference_page_say_what_a_preset_is(rgb, name):
    renderer = mi.load_dict({"type": "restir_pt", "preset": name})
    page = " ".join(type(renderer).__doc__.split())
    assert in_words(name) in page
    for parameter, value in PRESETS[name].items():
        assert f"{parameter}={value!r}" in str(renderer)


def test_words_are_those_of_scene_files(monkeypatch):
    values = {"guiding": True, "spatial_radius": 40.0, "mutations": 2, "roulette": "contribution"}
    monkeypatch.setattr(presets, "PRESETS", {"some": values})
    assert in_words("some") == (
        "``guiding=true``, ``spatial_radius=40``, ``mutations=2``, ``roulette=contribution``"
    )


@pytest.mark.parametrize("wrong", ["best", "", "Raw", 1])
def test_an_unknown_preset_is_one_clear_line(rgb, wrong):
    with pytest.raises(Exception, match="preset must be one of none, fast, raw, denoised, not"):
        mi.load_dict({"type": "restir_pt", "preset": wrong})


def test_unknown_on_the_command_line(capsys):
    assert cli.main(["render", "ajar", "-p", "preset=best"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "preset must be one of none, fast, raw, denoised, not 'best'" in error


@pytest.mark.parametrize(
    ("options", "preset"),
    [
        ([], "none"),
        (["--denoise"], "denoised"),
        (["--denoise", "-p", "preset=raw"], "raw"),
        (["--denoise", "-p", "preset=none"], "none"),
        (["-p", "preset=fast"], "fast"),
    ],
)
def test_what_is_denoised_takes_its_preset_unless_told_otherwise(monkeypatch, options, preset):
    class Seen(Exception):
        pass

    def make(kind, parameters):
        seen.append(loading_make(kind, parameters).parameters.preset)
        raise Seen

    seen: list[str] = []
    loading_make = loading.make_integrator
    monkeypatch.setattr(denoising, "require", lambda: None)
    monkeypatch.setattr(loading, "make_integrator", make)
    with pytest.raises(Seen):
        cli.main(["render", "ajar", *options])
    assert seen == [preset]


def test_what_a_preset_was_is_in_the_picture(rgb, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    size = ["--resolution", "8x6", "-p", "max_depth=2"]
    assert cli.main(["render", "ajar", *size, "-p", "preset=raw", "-o", "out.exr"]) == 0
    assert "preset=raw" in str(mi.Bitmap(str(Path("out.exr"))).metadata()["parameters"])


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize("name", NAMED)
def test_the_image_of_a_preset_is_that_of_path(rgb, name):
    """No preset is biased, and none says that it is."""
    assert parameters_of(preset=name).biased == ()
    case, mode = references.CASES["room"], Mode({"preset": name}, frames=4)
    runs = independent_runs(integrator(case.max_depth, mode), case.load(), mode)
    report = bias_report(runs, RUNS, *references.load("room"))
    assert_unbiased(report, f"room-preset-{name}", POWER)
