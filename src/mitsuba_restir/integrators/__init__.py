"""The plugins: one integrator per file, registered for every variant that can run it."""

from __future__ import annotations

import importlib
import sys


def register() -> None:
    """Register the plugins for Mitsuba's current variant (call after every variant change)."""
    name = __name__ + ".restir_pt"
    if name in sys.modules:
        importlib.reload(sys.modules[name])
    else:
        importlib.import_module(name)
