"""Colour of a path: its wavelengths, the sensor's response to it, and the target function.

In RGB and monochrome variants a path has no wavelengths. In spectral variants the wavelength sample
is one more primary sample of the path: it is drawn from the path's own stream, replayed with it,
and a shifted path is evaluated at the wavelengths of its source (Jacobian 1).
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from ..sampling import streams


def wavelengths(sensor: mi.Sensor, stream: streams.Stream) -> tuple[mi.Spectrum, mi.Spectrum]:
    """Wavelengths [nm] of a path and the weight of having sampled them (both per lane)."""
    if not mi.is_spectral:
        return dr.zeros(mi.Color0f), mi.Spectrum(1.0)
    u, _ = streams.uniform2(stream, 0, streams.WAVELENGTH)
    return sensor.sample_wavelengths(dr.zeros(mi.SurfaceInteraction3f), u)


def response(value: mi.Spectrum, lambdas: mi.Spectrum) -> mi.Color3f:
    """Sensor response (linear sRGB) to a spectral value."""
    if mi.is_spectral:
        return mi.spectrum_to_srgb(value, lambdas)
    if mi.is_monochromatic:
        return mi.Color3f(value[0])
    return mi.Color3f(value)


def target(color: mi.Color3f) -> mi.Float:
    """Target function p-hat: the luminance of a path's integrand (visibility included)."""
    return mi.luminance(color)
