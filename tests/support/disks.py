"""Disks that are full."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


def refuse(monkeypatch: pytest.MonkeyPatch, ending: str) -> None:
    """Have the disk be full for files whose names end like this."""
    replace = os.replace

    def full(source: str | Path, target: str | Path) -> None:
        if str(target).endswith(ending):
            raise OSError(28, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(os, "replace", full)
