"""Recording a frame: its stages are traced once and replayed from then on."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import drjit as dr
import mitsuba as mi

from ..errors import root
from .frame import Plan

KEPT = 4
"""Recordings kept of a stage: there is one for every structure of its inputs (the first frame has
another one than later frames, and objects outside the scene count as well)."""

NEVER = 2**32 - 1


class Stage:
    """A stage of the frame with the plan bound, recorded once and replayed from then on.

    Freezing skips re-tracing the Python code; the kernels are the same, so the images are too. Some
    scenes cannot be recorded, because Mitsuba 3.9 does not expose all of their state (a bitmap on
    an area light; the colour matching tables of spectral variants): they are traced every frame.
    """

    def __init__(self, stage: Callable[..., Any], plan: Plan) -> None:
        def bound(*inputs: Any) -> Any:
            return stage(plan, *inputs)

        self._traced = bound
        self._recorded: Any = None
        self._recordable = not mi.is_spectral
        self.forget()

    def forget(self) -> None:
        """Drop what is recorded: the scene is no longer the one that it was recorded of."""
        if self._recordable:
            # To record often is no mistake here, and needs no warning.
            self._recorded = dr.freeze(self._traced, limit=KEPT, warn_after=NEVER)

    def __call__(self, *inputs: Any) -> Any:
        """Run the stage on its inputs (plain data)."""
        if self._recordable:
            try:
                return self._recorded(*inputs)
            except RuntimeError as error:
                # Ctrl-C while a stage is being recorded says nothing of whether it can be.
                if "record" not in str(error) or isinstance(root(error), KeyboardInterrupt):
                    raise
                self._recordable, self._recorded = False, None
        return self._traced(*inputs)


@contextmanager
def collection_paused() -> Iterator[None]:
    """No garbage collection inside: to free a scene while a frame is recorded aborts Dr.Jit 1.5."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
