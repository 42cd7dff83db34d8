"""Mutants: functions of the package with one piece left out, to show that the tests would see it.

A mutant is a replacement in a function's source text. It fails loudly where the text is no longer
there, so that a control cannot lose its meaning unnoticed.
"""

from __future__ import annotations

import inspect
import itertools
import linecache
import sys
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import pytest

_NUMBER = itertools.count()


@dataclass(frozen=True)
class Mutation:
    """In ``module`` (below ``mitsuba_restir``), ``function``: ``old`` becomes ``new``."""

    module: str
    function: str
    old: str
    new: str


def apply(monkeypatch: pytest.MonkeyPatch, mutations: tuple[Mutation, ...]) -> None:
    """Put mutants in the place of the originals, in every module that imported them."""
    for mutation in mutations:
        module = sys.modules[f"mitsuba_restir.{mutation.module}"]
        original = getattr(module, mutation.function)
        mutant = _mutant(module, original, mutation)
        for name, other in list(sys.modules.items()):
            if not name.startswith("mitsuba_restir"):
                continue
            for key, value in list(vars(other).items()):
                if value is original:
                    monkeypatch.setattr(other, key, mutant)


def _mutant(module: Any, original: Callable[..., Any], mutation: Mutation) -> Callable[..., Any]:
    source = textwrap.dedent(inspect.getsource(original))
    found = source.count(mutation.old)
    assert found == 1, f"{mutation.function} has {found} times the text {mutation.old!r}"
    source = source.replace(mutation.old, mutation.new)
    # Dr.Jit reads the source of symbolic loops again, so the mutant needs a place to be read from.
    filename = f"<mutant {next(_NUMBER)} of {mutation.function}>"
    header = "from __future__ import annotations\n"
    text = header + source
    linecache.cache[filename] = (len(text), None, text.splitlines(keepends=True), filename)
    names = dict(vars(module))
    names["dr"] = dr
    exec(compile(text, filename, "exec"), names)
    return names[mutation.function]
