"""Import the package before any test imports Mitsuba: Dr.Jit loads its LLVM at import."""

import mitsuba_restir  # noqa: F401  isort: skip

import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import pytest

from mitsuba_restir import cache
from mitsuba_restir.cli import machine

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell in the background ignores Ctrl-C for its children; the tests of it do not.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def _variant(name: str) -> str:
    if mi.variant() != name:
        mi.set_variant(name)
    return name


@pytest.fixture
def rgb() -> str:
    return _variant("llvm_ad_rgb")


@pytest.fixture
def spectral() -> str:
    return _variant("llvm_ad_spectral")


@pytest.fixture
def mono() -> str:
    return _variant("llvm_ad_mono")


@pytest.fixture
def one_thread() -> Iterator[None]:
    """One thread of Dr.Jit, for tests of many small frames.

    A second one has nothing to do there and spins while it waits, which takes a third of the test's
    time, and more under load. Not for tests that write pictures: with one thread, Mitsuba 3.9 waits
    for ever when it writes an EXR.
    """
    threads = dr.thread_count()
    dr.set_thread_count(1)
    yield
    dr.set_thread_count(threads)


@pytest.fixture
def two_threads(one_thread: None) -> None:
    """Two threads of Dr.Jit, also among tests that have one: for what their order might change.

    A kernel is shared between them from about 64x64 pixels on (`rooms.large_sensor`).
    """
    dr.set_thread_count(2)


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache of references and masks for this test alone."""
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 96 KiB, where this process may mount one."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=96k", "mitsuba-restir-test", str(place)]
    try:
        done = subprocess.run(mount, capture_output=True, check=False)
    except FileNotFoundError:
        pytest.skip("a full disk is tested where there is `mount`")
    if done.returncode:
        pytest.skip("a full disk is tested where this user may mount one (root on Linux)")
    yield place
    subprocess.run(["umount", str(place)], check=True)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="the browser test needs playwright: pip install playwright"
    )
    found = machine.browser()
    if found is None:
        pytest.skip("no Chromium found: install it (Debian: sudo apt install chromium)")
    with playwright.sync_playwright() as driver:
        # Containers run as root, where Chromium has no sandbox.
        chromium = driver.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield chromium
        chromium.close()
