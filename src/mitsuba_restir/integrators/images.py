"""The parameter ``aovs``: read and written."""

from __future__ import annotations

from collections.abc import Mapping


def images_of(aovs: str) -> tuple[tuple[str, str], ...]:
    """Name and type of each auxiliary image that the parameter ``aovs`` asks for."""
    entries = (entry.strip().partition(":") for entry in aovs.split(",") if entry.strip())
    return tuple((name, kind or name) for name, _, kind in entries)


def asking_for(images: Mapping[str, str]) -> str:
    """The parameter ``aovs``, of `restir_pt` as of Mitsuba's ``aov``, for images: name to type."""
    return ",".join(f"{name}:{kind}" for name, kind in images.items())
