"""Primary hits: one camera ray per pixel and frame, shared by all of the pixel's candidates."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.camera import Eye, eye_of
from ..paths.grid import Grid
from ..paths.packing import pack_facing
from ..paths.primary_hit import Primary, PrimaryHit
from ..paths.spectrum import Spectra, response
from ..paths.vertex import compact
from ..sampling.streams import WAVELENGTH, FrameKey, PathName, Purpose, uniform2
from ..shifts.connectability import pixel_footprint


@dataclass
class CameraRays:
    """One camera ray of every pixel.

    Fields: ``ray``, ``importance`` (what the sensor weighs it with), ``film`` (film position in the
    crop window's unit square), ``lens`` (lens sample), ``eye`` (of a pinhole camera, else None).
    """

    ray: mi.Ray3f
    importance: mi.Spectrum
    film: mi.Point2f
    lens: mi.Point2f
    eye: Eye | None


def camera_rays(sensor: mi.Sensor, grid: Grid, key: FrameKey) -> CameraRays:
    """Sample the camera rays of a frame."""
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
    ray, importance = sensor.sample_ray(
        sensor.shutter_open() + time * sensor.shutter_open_time(), lambda_sample, film, lens
    )
    return CameraRays(ray, importance, film, lens, eye_of(sensor))


def primary(
    scene: mi.Scene,
    rays: CameraRays,
    spectra: Spectra | None,
    hides_emitters: bool,
    small: bool,
) -> Primary:
    """Trace the camera rays of a frame.

    Parameters
    ----------
    hides_emitters : bool
        Whether lights are hidden that are seen directly.
    small : bool
        Whether the scene is a compact one.
    """
    ray = rays.ray
    pi = scene.ray_intersect_preliminary(ray, coherent=True)
    if hides_emitters:
        on_light = pi.is_valid() & (pi.shape.emitter() != None)  # noqa: E711
        light = pi.compute_surface_interaction(ray, mi.RayFlags.Minimal, on_light)
        # Every integrator of Mitsuba can do this.
        skip = mi.load_dict({"type": "path"}).skip_area_emitters
        pi = dr.select(on_light, skip(scene, light.spawn_ray(ray.d), True, on_light), pi)
    si = pi.compute_surface_interaction(ray)
    shows_sky = not hides_emitters and scene.environment() is not None
    emitted = mi.Spectrum(0)
    if not hides_emitters:
        emitted = rays.importance * si.emitter(scene).eval(si)
    facing = pack_facing(si.sh_frame.n, pixel_footprint(ray.o, si))
    hit = PrimaryHit(compact(pi, si.p, small), facing, rays.eye or mi.Point3f(ray.o))
    return Primary(
        hit,
        response(spectra, emitted, ray.wavelengths),
        mi.Float(1 if shows_sky else 0),
        rays.film,
        rays.lens,
    )
