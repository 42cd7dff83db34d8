"""Colour of a path: its wavelengths, the sensor's response to it, and the target function.

In RGB and monochrome variants a path has no wavelengths. In spectral variants the wavelength sample
is one more primary sample of the path: it is drawn from the path's own stream, replayed with it,
and a shifted path is evaluated at the wavelengths of its source (Jacobian 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..sampling import streams

FIRST, LAST, NODES = 360.0, 830.0, 95
"""Wavelengths [nm] between which Mitsuba's colour matching functions are tabulated, linear between
nodes at equal distances."""


@dataclass
class Sensitivity:
    """How the sensor responds to wavelengths, as data.

    Mitsuba's own tables belong to no object, and what is computed with them cannot be recorded.

    Fields: ``srgb`` (linear sRGB of a unit of spectral radiance at every node).
    """

    srgb: mi.Color3f


def sensitivity() -> Sensitivity | None:
    """Mitsuba's tables; None in variants without wavelengths."""
    if not mi.is_spectral:
        return None
    step = (LAST - FIRST) / (NODES - 1)
    node = FIRST + step * dr.arange(mi.Float, NODES)
    one = dr.zeros(mi.Spectrum, NODES)
    one[0] = float(len(one))
    found = Sensitivity(mi.spectrum_to_srgb(one, mi.Spectrum(node)))
    dr.make_opaque(found)
    return found


@dataclass
class Spectra:
    """What wavelengths are sampled by, and what they are seen as.

    Fields: ``sensor``, ``sensitivity``.
    """

    sensor: mi.Sensor
    sensitivity: Sensitivity


def spectra_of(sensor: mi.Sensor, sensitivity: Sensitivity | None) -> Spectra | None:
    """Both in one; None in variants without wavelengths."""
    return None if sensitivity is None else Spectra(sensor, sensitivity)


def wavelengths(spectra: Spectra | None, stream: streams.Stream) -> tuple[mi.Spectrum, mi.Spectrum]:
    """Wavelengths [nm] of a path and the weight of having sampled them (both per lane)."""
    if spectra is None:
        return dr.zeros(mi.Color0f), mi.Spectrum(1.0)
    u, _ = streams.uniform2(stream, 0, streams.WAVELENGTH)
    return spectra.sensor.sample_wavelengths(dr.zeros(mi.SurfaceInteraction3f), u)


def response(spectra: Spectra | None, value: mi.Spectrum, lambdas: mi.Spectrum) -> mi.Color3f:
    """Sensor response (linear sRGB) to a spectral value, as ``mi.spectrum_to_srgb`` has it."""
    if spectra is not None:
        return _seen(spectra.sensitivity, value, lambdas)
    if mi.is_monochromatic:
        return mi.Color3f(value[0])
    return mi.Color3f(value)


def _seen(sensitivity: Sensitivity, value: mi.Spectrum, lambdas: mi.Spectrum) -> mi.Color3f:
    color = mi.Color3f(0)
    for part, wavelength in zip(value, lambdas, strict=True):
        place = (wavelength - FIRST) * ((NODES - 1) / (LAST - FIRST))
        known = (wavelength >= FIRST) & (wavelength <= LAST)
        node = mi.UInt32(dr.clip(place, 0, NODES - 2))
        below, above = (dr.gather(mi.Color3f, sensitivity.srgb, node + i, known) for i in range(2))
        color += part * dr.lerp(below, above, place - mi.Float(node))
    return color / len(value)


def target(color: mi.Color3f) -> mi.Float:
    """Target function p-hat: the luminance of a path's integrand (visibility included)."""
    return mi.luminance(color)
