"""A part of a structure that it does without."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Absent:
    """Stands for a part that is not needed: Dr.Jit goes through it and finds nothing."""
