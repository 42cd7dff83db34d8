"""Recording a frame: its stages are traced once and replayed from then on."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import drjit as dr

from ..errors import root
from .flat import Structure, flatten, unflatten

KEPT = 4
"""Recordings kept of a stage: there is one for every structure of its inputs (the first frame has
another one than later frames, and objects outside the scene count as well)."""

NEVER = 2**32 - 1


class _Signature:
    """Stands for the structure of inputs, and remembers the structure of what comes out of them."""

    def __init__(self, inputs: Structure) -> None:
        self.inputs = inputs
        self.outputs: Structure = None


class _Sealed:
    """Holds a function whose references are not to be looked into."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.call = function


class Stage:
    """A stage of the frame with the plan bound, recorded once and replayed from then on.

    Freezing skips re-tracing the Python code; the kernels are the same, so the images are too. Some
    scenes cannot be recorded, because Mitsuba 3.9 does not expose all of their state (a bitmap on
    an area light; ``ellipsoidsmesh``): they are traced every frame.
    """

    def __init__(self, stage: Callable[..., Any], plan: Any) -> None:
        def traced(signature: _Signature, leaves: list[Any]) -> list[Any]:
            results: list[Any] = []
            inputs = unflatten(signature.inputs, iter(leaves))
            signature.outputs = flatten(stage(plan, *inputs), results)
            return results

        self._traced = traced
        self._signatures: dict[Structure, _Signature] = {}
        self._recordable = True
        self.forget()

    def forget(self) -> None:
        """Drop what is recorded: the scene is no longer the one that it was recorded of."""
        sealed = _Sealed(self._traced)

        # Dr.Jit compares all that the function refers to at every call: one object here.
        def recorded(signature: _Signature, leaves: list[Any]) -> list[Any]:
            return sealed.call(signature, leaves)

        # To record often is no mistake here, and needs no warning.
        self._recorded = dr.freeze(recorded, limit=KEPT, warn_after=NEVER)

    def __call__(self, *inputs: Any) -> Any:
        """Run the stage on its inputs (plain data)."""
        leaves: list[Any] = []
        structure = flatten(inputs, leaves)
        signature = self._signatures.setdefault(structure, _Signature(structure))
        results = self._run(signature, leaves)
        return unflatten(signature.outputs, iter(results))

    def _run(self, signature: _Signature, leaves: list[Any]) -> list[Any]:
        if self._recordable:
            try:
                return self._recorded(signature, leaves)
            except RuntimeError as error:
                # Ctrl-C while a stage is being recorded says nothing of whether it can be.
                if "record" not in str(error) or isinstance(root(error), KeyboardInterrupt):
                    raise
                self._recordable = False
                self.forget()
        return self._traced(signature, leaves)


_TURN = threading.RLock()


def frame_alone() -> AbstractContextManager[Any]:
    """One frame at a time in a process; other threads wait here, before they look at a scene.

    Dr.Jit 1.5 keeps what it replays in variables of the process and holds its own lock while it
    calls Python, which may pass to another thread: two recorded functions in two threads end in
    "unknown variable" or wait for each other for ever. A recorded function also goes over the
    objects of all scenes before and after its kernels, as Python objects if they have been looked
    at, and crashes on one that was first looked at in between.
    """
    return _TURN


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
