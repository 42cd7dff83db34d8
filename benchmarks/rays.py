"""Rays per pixel and frame that a Python integrator traces, counted exactly."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from . import harness
from .task import Task

_NEAREST, _SHADOW = 0, 1


def measure(task: Task) -> dict[str, float]:
    """Measure in this process; empty for integrators whose rays Python does not see."""
    renderer = task.renderer()
    if renderer.statistics is None:
        return {}
    task.render(renderer, 0, 1)
    with counted_rays() as counter:
        task.render(renderer, 1, task.warmup)
        counter.take()
        task.render(renderer, task.warmup + 1, task.study.frames)
        nearest, shadow = counter.take()
    scale = 1.0 / (task.pixels * task.study.frames)
    return {
        "nearest-hit rays": nearest * scale,
        "shadow rays": shadow * scale,
        "all rays": (nearest + shadow) * scale,
    }


@dataclass
class RayCounter:
    """
    Rays traced since the last `take`.

    Fields
    ------
    counts : UInt32, (2,)
        Rays that look for the nearest hit, and rays that only test for one.
    """

    counts: Any

    def take(self) -> tuple[int, int]:
        """Return the number of nearest-hit and of shadow rays, and start again from zero."""
        dr.eval(self.counts)
        nearest, shadow = (int(count) for count in self.counts)
        self.counts = _zeros()
        return nearest, shadow


def _zeros() -> Any:
    counts = dr.zeros(mi.UInt32, 2)
    # A literal would be a new variable inside every kernel that adds to it.
    dr.make_opaque(counts)
    return counts


@contextmanager
def counted_rays() -> Iterator[RayCounter]:
    """
    Count the rays that Python code traces through ``mi.Scene`` while the context is open.

    Frames are not frozen meanwhile (they would be replayed without counting), and light sampling is
    evaluated twice, since only lanes with a sample trace a shadow ray: the images stay the same,
    the times do not. Rays of integrators in C++, such as `path`, are not seen.
    """
    counter = RayCounter(_zeros())
    scene = mi.Scene
    names = ("ray_intersect_preliminary", "ray_intersect", "ray_test", "sample_emitter_direction")
    originals = {name: getattr(scene, name) for name in names}
    freezing = dr.flag(dr.JitFlag.KernelFreezing)
    dr.set_flag(dr.JitFlag.KernelFreezing, False)
    scene.ray_intersect_preliminary = _counting(
        counter, originals["ray_intersect_preliminary"], _NEAREST
    )
    scene.ray_intersect = _counting(counter, originals["ray_intersect"], _NEAREST)
    scene.ray_test = _counting(counter, originals["ray_test"], _SHADOW)
    scene.sample_emitter_direction = _counting_light_samples(
        counter, originals["sample_emitter_direction"]
    )
    try:
        yield counter
    finally:
        for name, original in originals.items():
            setattr(scene, name, original)
        dr.set_flag(dr.JitFlag.KernelFreezing, freezing)


def _add(counter: RayCounter, kind: int, active: Any) -> None:
    dr.scatter_add(counter.counts, mi.UInt32(1), mi.UInt32(kind), mi.Bool(active))


def _counting(counter: RayCounter, original: Callable[..., Any], kind: int) -> Callable[..., Any]:
    def method(self: Any, ray: Any, *args: Any, **kwargs: Any) -> Any:
        # `active` is the last argument of all overloads; a lone one is it for shadow rays only.
        last = args[-1] if len(args) > (1 if kind == _NEAREST else 0) else True
        active = mi.Bool(kwargs.get("active", last))
        # A literal mask has one lane, a ray as many as there are pixels.
        _add(counter, kind, active & (ray.maxt == ray.maxt))
        return original(self, ray, *args, **kwargs)

    return method


def _counting_light_samples(
    counter: RayCounter, original: Callable[..., Any]
) -> Callable[..., Any]:
    def method(
        self: Any, ref: Any, sample: Any, test_visibility: bool = True, active: Any = True
    ) -> Any:
        if test_visibility:
            unoccluded, _ = original(self, ref, sample, False, active)
            _add(counter, _SHADOW, active & (unoccluded.pdf != 0.0))
        return original(self, ref, sample, test_visibility, active)

    return method


if __name__ == "__main__":
    sys.exit(harness.main("rays"))
