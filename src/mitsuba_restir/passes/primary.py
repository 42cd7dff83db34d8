"""Primary hits: one camera ray per pixel and frame, shared by all of the pixel's candidates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.spectrum import response
from ..paths.vertex import compact
from ..sampling.streams import PRIMARY, WAVELENGTH, pass_stream, path_stream, uniform2
from ..shifts.connectability import pixel_footprint


@dataclass
class Primary:
    """What the camera sees directly.

    Fields: ``hit`` (:class:`PrimaryHit`), ``emitted`` (``Color3f``, light seen directly), ``alpha``
    (``Float``), ``film`` (``Point2f``, film position in the crop window's unit square), ``lens``
    (``Point2f``, lens sample).
    """

    hit: PrimaryHit
    emitted: Any
    alpha: Any
    film: Any
    lens: Any


def primary(
    scene: mi.Scene,
    sensor: mi.Sensor,
    sample: Any,
    seed: Any,
    skip_emitters: Callable[..., Any] | None,
) -> Primary:
    """Trace the camera rays of a frame.

    Parameters
    ----------
    sample, seed : UInt32
        Running number of the frame's first sample and the user's seed (opaque).
    skip_emitters : callable or None
        ``(scene, ray, coherent, active) -> PreliminaryIntersection3f`` past all area lights, which
        hides directly visible lights; None shows them.
    """
    columns, rows = sensor.film().crop_size()
    width, height = dr.opaque(mi.UInt32, columns), dr.opaque(mi.UInt32, rows)
    pixel = dr.arange(mi.UInt32, columns * rows)
    choices = pass_stream(PRIMARY, pixel, sample, seed)
    y = pixel // width
    x = pixel - y * width
    jitter = mi.Point2f(*uniform2(choices, 0, 0))
    lens = mi.Point2f(*uniform2(choices, 0, 1))
    time, lambda_sample = uniform2(choices, 0, 2)
    film = (mi.Point2f(x, y) + jitter) / mi.Vector2f(width, height)
    if mi.is_spectral:
        # The same wavelengths as the pixel's first path, so that their colours belong together.
        lambda_sample = uniform2(path_stream(pixel, sample, seed), 0, WAVELENGTH)[0]
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
    hit = PrimaryHit(
        compact(pi, si.p), mi.Point3f(ray.o), si.sh_frame.n, pixel_footprint(ray.o, si)
    )
    return Primary(
        hit,
        response(emitted, ray.wavelengths),
        dr.select(si.is_valid() | shows_sky, mi.Float(1), 0),
        film,
        lens,
    )
