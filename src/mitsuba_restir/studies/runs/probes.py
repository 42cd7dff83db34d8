"""Measurements that no image shows: kernels, rays, memory, the first frame, what shifts do.

Each probe runs in a process of its own, so that it sees a fresh allocator and, where it asks for
one, an empty kernel cache, and so that it cannot disturb the times of a study.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ...errors import RenderError, one_line
from ..config.study import Size, Study
from ..config.tables import to_table
from .results import ReferenceImage

Reference = Callable[[], ReferenceImage | None]

Probe = Callable[..., Mapping[str, float]]
"""Measures (study, size, name of the variant, number of the run, what loads the reference)."""


def _unknown() -> None:
    """The reference of a study that has none."""


_PROLOGUE = "from mitsuba_restir.studies.measure.probe_child import main; main()"


def _run_child(
    study: Study,
    kind: str,
    size: Size,
    variant: str,
    index: int,
    home: str | None = None,
    reference: str = "",
) -> dict[str, float]:
    """Measure in a fresh process, with a home directory of its own where one is given."""
    request = {
        "study": to_table(study),
        "kind": kind,
        "size": list(size),
        "variant": variant,
        "index": index,
        "reference": reference,
    }
    environment = dict(os.environ)
    if home is not None:
        # Dr.Jit keeps compiled kernels below the home directory.
        environment["HOME"] = environment["LOCALAPPDATA"] = home
    done = subprocess.run(
        [sys.executable, "-c", _PROLOGUE],
        input=json.dumps(request),
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    lines = done.stdout.strip().splitlines()
    if done.returncode or not lines:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise RenderError(f"{study.name}: probe '{kind}' of '{variant}' failed: {one_line(last)}")
    answer: dict[str, float] = json.loads(lines[-1])
    return answer


def _simple(kind: str) -> Probe:
    def probe(
        study: Study, size: Size, variant: str, index: int, reference: Reference = _unknown
    ) -> dict[str, float]:
        return _run_child(study, kind, size, variant, index)

    return probe


def _mutation_spectra(
    study: Study, size: Size, variant: str, index: int, reference: Reference = _unknown
) -> dict[str, float]:
    """Spectra need the truth, which may have been rendered: it goes along as a file."""
    known = reference()
    assert known is not None
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "reference.npz")
        np.savez(file, image=known.image, variance=known.variance, smooth=known.smooth)
        return _run_child(study, "mutation_spectra", size, variant, index, reference=file)


def _startup(
    study: Study, size: Size, variant: str, index: int, reference: Reference = _unknown
) -> dict[str, float]:
    """First frame of a process with an empty kernel cache, and of the next one, which finds it."""
    with tempfile.TemporaryDirectory() as home:
        return {
            f"{name}, {cache} kernel cache": seconds
            for cache in ("cold", "warm")
            for name, seconds in _run_child(
                study, "first_frame", size, variant, index, home
            ).items()
        }


PROBES: Mapping[str, Probe] = {
    "kernels": _simple("kernels"),
    "statistics": _simple("statistics"),
    "mutation_spectra": _mutation_spectra,
    "rays": _simple("rays"),
    "memory": _simple("memory"),
    "startup": _startup,
}
"""Probes by name."""

REFERENCED = frozenset({"mutation_spectra"})
"""Those whose answers depend on the reference."""
