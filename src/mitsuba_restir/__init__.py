"""ReSTIR path tracing for Mitsuba 3.

Importing this package makes an LLVM findable and registers the ``restir_pt`` integrator for the
current variant and for every variant chosen later.
"""

from __future__ import annotations

import sys as _sys
import warnings as _warnings
from importlib.util import find_spec as _find_spec
from pathlib import Path as _Path
from typing import Any as _Any

from .errors import root as _root

__all__ = ["__version__", "view"]

__version__ = "0.1.0"

_imported_first = "drjit" not in _sys.modules
try:
    from . import llvm as _llvm

    _chosen = _llvm.provide()

    import drjit as _dr  # Dr.Jit loads LLVM at import: it has to be chosen by then
    import mitsuba as _mi
except BaseException as error:
    # The command is not there yet to say it in a line; a program of one's own decides for itself.
    command = _Path(_sys.argv[0]).stem in ("mitsuba-restir", "-m")
    if not command or not isinstance(_root(error), KeyboardInterrupt):
        raise
    print("mitsuba-restir: interrupted", file=_sys.stderr)
    raise SystemExit(130) from None


def _on_variant_change(previous: str | None, current: str) -> None:
    from . import integrators

    integrators.register()


def _start() -> None:
    if not _imported_first:
        message = _llvm.too_late_message(_dr.detail.llvm_version(), _chosen)
        if message:
            _warnings.warn(message, RuntimeWarning, stacklevel=3)
    # With one thread, as on one core, Mitsuba 3.9 waits for ever when it writes an EXR.
    if _dr.thread_count() < 2:
        _dr.set_thread_count(2)
    _mi.detail.add_variant_callback(_on_variant_change)
    if _mi.variant() is not None:
        _on_variant_change(None, _mi.variant())


def view(scene: _Any, **options: _Any) -> _Any:
    """
    Show a scene live in a notebook: see :func:`mitsuba_restir.viewer.notebook.view`.

    Needs ``pip install 'mitsuba-restir[view]'``.
    """
    if _find_spec("nicegui") is None:
        raise ImportError("view needs pip install 'mitsuba-restir[view]'")
    from .viewer.notebook import view as shown

    return shown(scene, **options)


_start()
