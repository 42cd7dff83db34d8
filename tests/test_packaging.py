"""What pyproject.toml asks for can be installed on every platform."""

import sys
from pathlib import Path

import pytest
from packaging.requirements import Requirement

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

LINUX = {"sys_platform": "linux", "platform_machine": "x86_64", "python_version": "3.13"}


@pytest.mark.parametrize("extra", ["flip", "dev"])
@pytest.mark.parametrize(
    ("platform", "wanted"),
    [
        (LINUX, True),
        ({**LINUX, "python_version": "3.10"}, True),
        ({"sys_platform": "win32", "platform_machine": "AMD64", "python_version": "3.12"}, True),
        ({"sys_platform": "darwin", "platform_machine": "arm64", "python_version": "3.12"}, True),
        ({**LINUX, "python_version": "3.14"}, False),
        ({**LINUX, "platform_machine": "aarch64"}, False),
    ],
)
def test_flip_is_asked_for_where_it_has_wheels(extra, platform, wanted):
    text = (Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8")
    lines = tomllib.loads(text)["project"]["optional-dependencies"][extra]
    (flip,) = (found for line in lines if (found := Requirement(line)).name == "flip-evaluator")
    assert flip.marker is not None
    assert flip.marker.evaluate(platform) is wanted
