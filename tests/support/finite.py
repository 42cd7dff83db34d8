"""Values that must not be in a frame or a history: what is not finite, and less light than none."""

from __future__ import annotations

from typing import Any

import numpy as np


def not_finite(image: Any) -> int:
    """Pixels of a picture that are not finite."""
    return int((~np.isfinite(np.array(image)[..., :3])).any(axis=-1).sum())


def poisoned(renderer: Any) -> int:
    """Values of the history that are not finite."""
    return sum(int((~np.isfinite(value)).sum()) for value in _history(renderer))


def negative(image: Any, renderer: Any) -> int:
    """Values of a picture and of the history that are below zero."""
    values = [np.array(image)[..., :3], *_history(renderer)]
    return sum(int((value < 0).sum()) for value in values)


def _history(renderer: Any) -> list[np.ndarray]:
    history = renderer._history
    values = [history.reservoirs.weight, history.reservoirs.color, history.reservoirs.confidence]
    values += [history.reservoirs.path.radiance, history.reservoirs.path.factor]
    if history.colors is not None:
        values += [history.colors.color]
    return [np.array(value) for value in values]
