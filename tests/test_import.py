"""The package can be imported before or after Mitsuba, with any number of variant switches."""

import os
import subprocess
import sys
import textwrap

import pytest

from mitsuba_restir import llvm

RENDER = """
def render():
    scene = mi.load_dict({
        "type": "scene",
        "sensor": {"type": "perspective", "film": {
            "type": "hdrfilm", "width": 4, "height": 4, "rfilter": {"type": "box"}}},
        "light": {"type": "constant"},
    })
    integrator = mi.load_dict({"type": "restir_pt"})
    assert mi.render(scene, integrator=integrator, spp=1).shape[:2] == (4, 4)
"""


def run(program: str, environment: dict[str, str] | None = None) -> None:
    """Run a program in a fresh interpreter, where Mitsuba has not been imported."""
    source = textwrap.dedent(program).replace("RENDER", RENDER)
    command = [sys.executable, "-W", "error", "-c", source]
    result = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert result.returncode == 0, result.stderr[-3000:]


def test_import_first_then_switch_variants():
    run("""
        import mitsuba_restir
        import mitsuba as mi
        RENDER
        for variant in ("llvm_ad_rgb", "llvm_ad_mono", "scalar_rgb", "llvm_ad_spectral",
                        "llvm_ad_rgb"):
            mi.set_variant(variant)
            if not variant.startswith("scalar"):
                render()
    """)


def test_import_after_mitsuba_and_its_variant():
    # A user whose Mitsuba finds a good LLVM itself; the environment variable stands for that.
    environment = dict(os.environ)
    if (library := llvm.find().path) is not None:
        environment[llvm.ENVIRONMENT_VARIABLE] = str(library)
    run(
        """
        import mitsuba as mi
        RENDER
        mi.set_variant("llvm_ad_rgb")
        import mitsuba_restir
        render()
        mi.set_variant("llvm_ad_mono")
        render()
        """,
        environment,
    )


@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_spectral_polarized"])
def test_variants_that_cannot_run_get_a_clear_error(variant):
    run(f"""
        import mitsuba_restir
        import mitsuba as mi
        mi.set_variant({variant!r})
        try:
            mi.load_dict({{"type": "restir_pt"}})
        except RuntimeError as error:
            assert {variant!r} in str(error), error
        else:
            raise AssertionError("no error")
    """)


def test_plugin_is_declared_for_mitsuba_3_10():
    from importlib.metadata import entry_points

    (entry,) = entry_points(group="mitsuba", name="restir_pt") or (None,)
    if entry is None:
        pytest.skip("the package is not installed")
    assert entry.value == "mitsuba_restir.integrators.restir_pt"


def test_stills_can_be_imported_without_a_variant():
    """And cost those who do not ask for them nothing."""
    run("""
        import sys
        import mitsuba_restir
        assert not any(name.startswith("mitsuba_restir.still") for name in sys.modules)
        assert "scipy" not in sys.modules
        from mitsuba_restir import still
        import mitsuba as mi
        assert mi.variant() is None
        assert callable(still.render)
        mi.set_variant("llvm_ad_rgb")
        RENDER
        render()
    """)


ONE_CORE = """
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import mitsuba_restir, mitsuba as mi, numpy as np
from mitsuba_restir.imageio import encode_exr
mi.set_variant("llvm_ad_rgb")
print(len(encode_exr(np.ones((8, 8, 3), np.float32))))
"""


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs Linux")
def test_pictures_are_written_on_one_core() -> None:
    done = subprocess.run(
        [sys.executable, "-c", ONE_CORE], capture_output=True, text=True, timeout=60, check=True
    )
    assert int(done.stdout) > 0
