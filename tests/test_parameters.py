"""Parameters are declared once: what the plugin, the command line and the documents say agrees."""

from __future__ import annotations

import re
from pathlib import Path

import mitsuba as mi
import pytest

from mitsuba_restir.cli.parameters import PARAMETERS as ON_THE_COMMAND_LINE
from mitsuba_restir.integrators.declaration import Value
from mitsuba_restir.integrators.parameters import PARAMETERS
from mitsuba_restir.passes.shade import AOVS

README = Path(__file__).parents[1] / "README.md"
TYPES = {bool: "bool", int: "int", float: "float", str: "string"}


def written(value: Value) -> str:
    """A default as the README writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f"`{value}`" if value else ""
    return f"{value:g}"


def table(text: str) -> dict[str, tuple[str, str, str]]:
    """Type, default and meaning by name, of the README's table; a row may hold several names."""
    section = text[text.index("## Parameters of `restir_pt`") :]
    rows = {}
    for line in section.splitlines():
        if line.startswith("| `"):
            *cells, meaning = re.split(r" *\| *", line.strip("| "), maxsplit=3)
            names, kinds, defaults = (cell.split(", ") for cell in cells)
            kinds = kinds * len(names) if len(kinds) == 1 else kinds
            for name, kind, default in zip(names, kinds, defaults, strict=True):
                rows[name.strip("`")] = (kind, default, meaning)
        elif rows and not line.startswith("|"):
            break
    return rows


def differences(rows: dict[str, tuple[str, str, str]]) -> list[str]:
    """Where the README says something else than the declarations."""
    found = [f"{name}: not in both" for name in rows.keys() ^ PARAMETERS.keys()]
    for name in rows.keys() & PARAMETERS.keys():
        parameter = PARAMETERS[name]
        expected = (TYPES[parameter.kind], written(parameter.default))
        if rows[name][:2] != expected:
            found.append(f"{name}: {rows[name][:2]} instead of {expected}")
        words = [*parameter.choices, *(AOVS if name == "aovs" else ())]
        missing = [word for word in words if f"`{word}`" not in " ".join(rows[name][1:])]
        found += [f"{name}: {word} is missing" for word in missing]
    return found


def test_the_readme_says_what_is_declared():
    assert differences(table(README.read_text())) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("| `confidence_cap` | float | 20 |", "| `confidence_cap` | float | 21 |"),
        ("| `confidence_cap` | float |", "| `confidence_cap` | int |"),
        ("| `confidence_cap` |", "| `confidence_cup` |"),
        ("or `reconnection`, `random_replay`", "or `reconnection`"),
        ("`confidence`, ", ""),
    ],
)
def test_control_a_readme_that_drifts_is_found(old, new):
    text = README.read_text()
    assert text.count(old) == 1
    assert differences(table(text.replace(old, new)))


def test_the_reference_page_has_every_parameter(rgb):
    page = type(mi.load_dict({"type": "restir_pt"})).__doc__
    for name, parameter in PARAMETERS.items():
        entry = re.search(rf"^ \* - {name}\n   - \|(\w+)\|\n((?:    ?.*\n)+)", page, re.MULTILINE)
        assert entry is not None, name
        assert entry[1] == TYPES[parameter.kind]
        words = [*parameter.choices, *(AOVS if name == "aovs" else ())]
        assert all(f"``{word}``" in entry[2] for word in words)
    assert max(map(len, page.splitlines())) <= 100


def test_the_command_line_has_every_parameter_but_those_with_an_option_of_their_own():
    assert PARAMETERS.keys() - ON_THE_COMMAND_LINE.keys() == {"aovs"}


def test_every_auxiliary_image_has_the_channels_that_it_names(rgb):
    scene = mi.load_dict(
        {
            "type": "scene",
            "sensor": {
                "type": "perspective",
                "film": {"type": "hdrfilm", "width": 4, "height": 3, "rfilter": {"type": "box"}},
            },
            "light": {"type": "constant"},
        }
    )
    for kind, aov in AOVS.items():
        more = {"blue_noise": "selection"} if aov.selects else {}
        renderer = mi.load_dict({"type": "restir_pt", "aovs": f"a:{kind}", **more})
        assert renderer.aov_names() == [f"a.{channel}" for channel in aov.channels]
        image = mi.render(scene, integrator=renderer, spp=1)
        assert image.shape == (3, 4, 3 + len(aov.channels))
