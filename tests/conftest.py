"""Import the package before any test imports Mitsuba: Dr.Jit loads its LLVM at import."""

import mitsuba_restir  # noqa: F401  isort: skip

import signal

import mitsuba as mi
import pytest

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
