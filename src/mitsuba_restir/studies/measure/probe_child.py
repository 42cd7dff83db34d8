"""The inside of a probe: one measurement in a fresh process, answered as one line of JSON."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import re
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...analysis.duplication import duplicated_share
from ..config.study import Size, Study
from ..config.tables import from_table
from ..runs.rays import counted_rays
from ..runs.rendering import Renderer, load_scene, make_renderer, seed_of
from ..runs.results import ReferenceImage
from .mutation_spectra import CHANNELS, numbers

_PROBE_KEY = 3
_REHEARSAL = 3


@dataclasses.dataclass(frozen=True)
class _Task:
    """
    What is measured: a variant of a study at one size, with the seeds of one run.

    `reference` is a file of NumPy with the reference image, for what needs one.
    """

    study: Study
    size: Size
    variant: str
    index: int
    reference: str = ""

    def renderer(self) -> Renderer:
        scene = load_scene(self.study)
        variant = self.study.variants[self.variant]
        return make_renderer(self.study, scene, self.size, self.variant, variant)

    def with_images(self, aovs: str) -> _Task:
        """The same with auxiliary images in place of the variant's own."""
        variant = self.study.variants[self.variant]
        variant = replace(variant, parameters={**variant.parameters, "aovs": aovs})
        study = replace(self.study, variants={**self.study.variants, self.variant: variant})
        return replace(self, study=study)

    def frames(self, renderer: Renderer, first: int, count: int) -> None:
        for frame in range(first, first + count):
            self.tensor(renderer, frame)

    def tensor(self, renderer: Renderer, frame: int) -> np.ndarray[Any, Any]:
        """Render a frame with all its channels."""
        if renderer.place is not None:
            renderer.place(max(self.warmup + self.study.frames - 1 - frame, 0))
        seed = seed_of(self.study.seed, _PROBE_KEY, self.index, frame)
        return np.array(renderer.draw(seed))

    @property
    def pixels(self) -> int:
        return self.size[0] * self.size[1]

    @property
    def warmup(self) -> int:
        """Frames before the measured ones; the first three compile and record."""
        return max(self.study.warmup, _REHEARSAL)


def _kernels(task: _Task) -> dict[str, float]:
    """Kernels compiled, fetched from the disk's cache, and launched, per frame after warm-up."""
    renderer = task.renderer()
    task.frames(renderer, 0, task.warmup)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        task.frames(renderer, task.warmup, task.study.frames)
        history = dr.kernel_history([dr.KernelType.JIT])
    frames = task.study.frames
    return {
        "kernels compiled per frame": sum(not k["cache_hit"] for k in history) / frames,
        "kernels read from disk per frame": sum(bool(k["cache_disk"]) for k in history) / frames,
        "kernels launched per frame": len(history) / frames,
    }


def _statistics(task: _Task) -> dict[str, float]:
    """Mean over the frames: what the integrator says of each, and the share of duplicated paths."""
    if task.study.variants[task.variant].type != "restir_pt":
        return {}
    renderer = task.with_images("path").renderer()
    assert renderer.statistics is not None
    task.frames(renderer, 0, task.warmup)
    found: dict[str, list[float]] = {}
    for frame in range(task.study.frames):
        image = task.tensor(renderer, task.warmup + frame)
        numbers = _flat(renderer.statistics()) | _duplicated(image[..., -3:].astype(np.int64))
        for name, value in numbers.items():
            found.setdefault(name, []).append(value)
    return {name: float(np.mean(values)) for name, values in found.items()}


def _duplicated(paths: np.ndarray[Any, Any]) -> dict[str, float]:
    """Share of duplicated paths in the three images of the auxiliary image ``path``."""
    stages = ("before mutations", "after mutations", "after spatial reuse")
    return {
        f"duplicated paths r=8, {stage}": duplicated_share(paths[..., index])
        for index, stage in enumerate(stages)
    }


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, float]:
    flat: dict[str, float] = {}
    for name, value in table.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}: ")
        elif isinstance(value, bool | int | float):
            flat[f"{prefix}{name}"] = float(value)
    return flat


def _mutation_spectra(task: _Task) -> dict[str, float]:
    """Spectra before and after spatial reuse; empty for integrators without mutations."""
    with np.load(task.reference) as file:
        reference = ReferenceImage(file["image"], file["variance"], float(file["smooth"]))
    renderer = task.with_images(CHANNELS).renderer()
    if renderer.statistics is None:
        return {}
    task.frames(renderer, 0, task.warmup)
    found = [
        numbers(task.tensor(renderer, task.warmup + frame), reference)
        for frame in range(task.study.frames)
    ]
    return {name: float(np.mean([each[name] for each in found])) for name in found[0]}


def _rays(task: _Task) -> dict[str, float]:
    """Rays per pixel and frame; empty for integrators whose rays Python does not see."""
    renderer = task.renderer()
    if renderer.statistics is None:
        return {}
    task.frames(renderer, 0, 1)
    with counted_rays() as counter:
        task.frames(renderer, 1, task.warmup)
        counter.take()
        task.frames(renderer, task.warmup + 1, task.study.frames)
        nearest, shadow = counter.take()
    scale = 1.0 / (task.pixels * task.study.frames)
    return {
        "nearest-hit rays": nearest * scale,
        "shadow rays": shadow * scale,
        "all rays": (nearest + shadow) * scale,
    }


def _memory(task: _Task) -> dict[str, float]:
    """Bytes: of the state kept between frames per pixel, and at the peak of a frame in all."""
    renderer = task.renderer()
    task.frames(renderer, 0, task.warmup)
    dr.detail.malloc_clear_statistics()
    _forget_resident_peak()
    task.frames(renderer, task.warmup, task.study.frames)
    backend = dr.backend_v(mi.Float)
    found = {"peak": float(dr.detail.malloc_watermark(backend)), **_resident()}
    if renderer.history is not None:
        history = renderer.history()
        found["reservoir"] = _bytes(history.reservoirs) / task.pixels
        found["path record"] = _bytes(history.reservoirs.path) / task.pixels
        found["reservoir and primary hit"] = _bytes(history) / task.pixels
    return found


def _forget_resident_peak() -> None:
    """Start the resident peak anew, so that loading the scene is not part of it (Linux)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _resident() -> dict[str, float]:
    """Peak of the resident memory in bytes; nothing where the system does not tell (not Linux)."""
    try:
        status = Path("/proc/self/status").read_text("utf-8")
    except OSError:
        return {}
    found = re.search(r"VmHWM:\s*(\d+) kB", status)
    return {"peak resident": float(found[1]) * 1024.0} if found else {}


def _bytes(value: Any) -> int:
    """Bytes of all arrays of a (nested) structure."""
    if dataclasses.is_dataclass(value):
        return sum(_bytes(getattr(value, field.name)) for field in dataclasses.fields(value))
    if isinstance(value, list | tuple):
        return sum(_bytes(entry) for entry in value)
    if not dr.is_array_v(value):
        return 0
    if dr.depth_v(value) > 1:
        return sum(_bytes(value[i]) for i in range(len(value)))
    return int(dr.width(value) * dr.itemsize_v(value))


def _first_frame(task: _Task) -> dict[str, float]:
    """Seconds until the scene is loaded, of the first frame, and of the fourth."""
    begin = time.perf_counter()
    renderer = task.renderer()
    loaded = time.perf_counter() - begin
    seconds = [
        renderer.frame(seed_of(task.study.seed, _PROBE_KEY, task.index, frame))[1]
        for frame in range(4)
    ]
    return {
        "loading": loaded,
        "first frame": seconds[0],
        "second frame": seconds[1],
        "fourth frame": seconds[3],
    }


_KINDS: Mapping[str, Callable[[_Task], dict[str, float]]] = {
    "kernels": _kernels,
    "statistics": _statistics,
    "mutation_spectra": _mutation_spectra,
    "rays": _rays,
    "memory": _memory,
    "first_frame": _first_frame,
}


def main() -> None:
    """Answer the request on standard input."""
    request = json.loads(sys.stdin.read())
    study = from_table(request["study"], request["study"]["name"])
    width, height = request["size"]
    name, index, reference = request["variant"], request["index"], request.get("reference", "")
    task = _Task(study, (width, height), name, index, reference)
    print(json.dumps(_KINDS[request["kind"]](task)))
