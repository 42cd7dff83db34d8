"""Mutants: functions of the package with one piece left out, to show that the tests would see it.

A mutant is a replacement in the source text of a function or method. It fails loudly where the text
is no longer there, so that a control cannot lose its meaning unnoticed.
"""

from __future__ import annotations

import inspect
import itertools
import linecache
import sys
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import pytest

_NUMBER = itertools.count()


_PACKAGES = (
    "paths",
    "shifts",
    "resampling",
    "neighbors",
    "mutations",
    "guiding",
    "passes",
)


@dataclass(frozen=True)
class Mutation:
    """In the one function or method of the core with the text ``old``, it becomes ``new``."""

    old: str
    new: str


def apply(monkeypatch: pytest.MonkeyPatch, mutations: tuple[Mutation, ...]) -> None:
    """Put mutants in the place of the originals, in every module that imported them."""
    for mutation in mutations:
        found = [
            (module, owner, function)
            for module in _modules()
            for owner in (module, *_classes(module))
            for function in _functions(module, owner)
            if mutation.old in inspect.getsource(function)
        ]
        assert len(found) == 1, f"{len(found)} functions have the text {mutation.old!r}"
        ((module, owner, original),) = found
        mutant = _mutant(module, original, mutation)
        for other in (owner, *(sys.modules[name] for name in _everywhere())):
            for key, value in list(vars(other).items()):
                if value is original:
                    monkeypatch.setattr(other, key, mutant)


def _classes(module: Any) -> list[type]:
    """Classes that the module defines."""
    members = vars(module).values()
    return [c for c in members if inspect.isclass(c) and c.__module__ == module.__name__]


def _functions(module: Any, owner: Any) -> Iterator[Callable[..., Any]]:
    """Functions of the module, or methods of one of its classes, that somebody wrote there."""
    for function in vars(owner).values():
        # A dataclass has methods from elsewhere; what an earlier mutation made is of the module.
        if inspect.isfunction(function) and function.__module__ == module.__name__:
            # What a dataclass generates has none.
            if inspect.unwrap(function).__code__.co_filename != "<string>":
                yield function


def _everywhere() -> list[str]:
    return [name for name in sys.modules if name.split(".")[0] in ("mitsuba_restir", "support")]


def _modules() -> list[Any]:
    return [
        sys.modules[name]
        for name in _everywhere()
        if name.startswith(tuple(f"mitsuba_restir.{package}." for package in _PACKAGES))
    ]


def _mutant(module: Any, original: Callable[..., Any], mutation: Mutation) -> Callable[..., Any]:
    source = textwrap.dedent(inspect.getsource(original))
    assert source.count(mutation.old) == 1, f"{original.__name__} has it twice: {mutation.old!r}"
    source = source.replace(mutation.old, mutation.new)
    # Dr.Jit reads the source of symbolic loops again, so the mutant needs a place to be read from.
    filename = f"<mutant {next(_NUMBER)} of {original.__name__}>"
    header = "from __future__ import annotations\n"
    text = header + source
    linecache.cache[filename] = (len(text), None, text.splitlines(keepends=True), filename)
    names = dict(vars(module))
    names["dr"] = dr
    exec(compile(text, filename, "exec"), names)
    return names[original.__name__]
