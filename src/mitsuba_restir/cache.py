"""The one folder of what is made once and kept: masks, and references of studies."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

VARIABLE = "MITSUBA_RESTIR_CACHE"
"""Environment variable that names another folder than the user's own."""


def cache_folder(kind: str) -> Path:
    """Return where things of a kind are kept, as "masks"; it may not exist yet."""
    given = os.environ.get(VARIABLE)
    own = platformdirs.user_cache_path("mitsuba-restir", appauthor=False)
    return (Path(given) if given else own) / kind
