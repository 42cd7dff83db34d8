"""Primary hits: one camera ray per pixel and frame, shared by all of the pixel's candidates."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import drjit as dr
import mitsuba as mi

from ..paths.camera import eye_of
from ..paths.grid import Grid
from ..paths.packing import pack_facing
from ..paths.primary_hit import Primary, PrimaryHit
from ..paths.spectrum import response
from ..paths.vertex import compact
from ..sampling.streams import WAVELENGTH, FrameKey, PathName, Purpose, uniform2
from ..shifts.connectability import pixel_footprint

SkipEmitters: TypeAlias = (
    "Callable[[mi.Scene, mi.Ray3f, bool, mi.Bool], mi.PreliminaryIntersection3f]"
)
"""(scene, ray, coherent, active) -> the intersection past all area lights."""


def primary(
    scene: mi.Scene,
    sensor: mi.Sensor,
    grid: Grid,
    key: FrameKey,
    skip_emitters: SkipEmitters | None,
    small: bool,
) -> Primary:
    """Trace the camera rays of a frame.

    Parameters
    ----------
    skip_emitters : callable or None
        Hides directly visible lights; None shows them.
    small : bool
        Whether the scene is a compact one.
    """
    pixel = grid.pixels()
    choices = key.stream(Purpose.PRIMARY, pixel)
    x, y = grid.place(pixel)
    jitter = mi.Point2f(*uniform2(choices, 0, 0))
    lens = mi.Point2f(*uniform2(choices, 0, 1))
    time, lambda_sample = uniform2(choices, 0, 2)
    film = (mi.Point2f(x, y) + jitter) / mi.Vector2f(grid.width, grid.height)
    if mi.is_spectral:
        # The same wavelengths as the pixel's first path, so that their colours belong together.
        own = PathName(pixel, key.sample, key.seed)
        lambda_sample = uniform2(own.stream(), 0, WAVELENGTH)[0]
    ray, weight = sensor.sample_ray(
        sensor.shutter_open() + time * sensor.shutter_open_time(), lambda_sample, film, lens
    )
    pi = scene.ray_intersect_preliminary(ray, coherent=True)
    if skip_emitters is not None:
        on_light = pi.is_valid() & (pi.shape.emitter() != None)  # noqa: E711
        light = pi.compute_surface_interaction(ray, mi.RayFlags.Minimal, on_light)
        pi = dr.select(on_light, skip_emitters(scene, light.spawn_ray(ray.d), True, on_light), pi)
    si = pi.compute_surface_interaction(ray)
    shows_sky = skip_emitters is None and scene.environment() is not None
    emitted = mi.Spectrum(0)
    if skip_emitters is None:
        emitted = weight * si.emitter(scene).eval(si)
    facing = pack_facing(si.sh_frame.n, pixel_footprint(ray.o, si))
    hit = PrimaryHit(compact(pi, si.p, small), facing, eye_of(sensor) or mi.Point3f(ray.o))
    return Primary(
        hit,
        response(emitted, ray.wavelengths),
        mi.Float(1 if shows_sky else 0),
        film,
        lens,
    )
