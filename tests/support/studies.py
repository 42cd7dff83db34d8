"""Studies that a test spells out."""

from __future__ import annotations

from pathlib import Path

from mitsuba_restir.studies import Study, load_study


def study_of(folder: Path, text: str, *changes: str) -> Study:
    """Read a study from the text of its file, with changes."""
    file = folder / "study.toml"
    file.write_text(text)
    return load_study(str(file), changes)
