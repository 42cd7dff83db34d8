"""The border: what ``restir_pt`` cannot render is refused in one line that says what to do."""

from __future__ import annotations

import operator
import warnings
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.camera import REPROJECTABLE
from ..paths.packing import MOST_INSTANCES, MOST_PRIMITIVES, number_of

WORDS = 2**32
"""Seeds and samples are counted by words of 32 bits."""

_ONE_PIXEL = ("RadianceMeter", "IrradianceMeter", "FluxMeter", "DistantSensorImpl")


def check_variant() -> str:
    """Name of the current variant; scalar and polarized ones are refused.

    Raises
    ------
    ValueError
        If the current variant has no JIT backend or tracks polarization.
    """
    variant = mi.variant()
    if variant.startswith("scalar") or "polarized" in variant:
        kind = "scalar" if variant.startswith("scalar") else "polarized"
        raise ValueError(
            f"restir_pt: {kind} variants are not supported (current: {variant}); choose another, "
            "for example mi.set_variant('cuda_ad_rgb', 'llvm_ad_rgb')"
        )
    return str(variant)


def check_same_variant(made: str, scene: mi.Scene, sensor: mi.Sensor) -> None:
    """Refuse what belongs to another variant: Dr.Jit would mix their types, or stop far from here.

    Parameters
    ----------
    made : str
        Variant under which the integrator was made.

    Raises
    ------
    ValueError
        If that, the scene's or the sensor's is not the current one.
    """
    now = mi.variant()
    if made != now:
        raise ValueError(
            f"restir_pt: the integrator was made under {made}, and the variant is now {now}; make "
            f"another one, or go back with mi.set_variant('{made}')"
        )
    for name, thing, kind in (("scene", scene, mi.Scene), ("sensor", sensor, mi.Sensor)):
        if not isinstance(thing, kind):
            raise ValueError(
                f"restir_pt: the {name} is none, or was loaded under another variant than {now}; "
                "load it again"
            )


def checked_seed(seed: Any) -> mi.UInt32:
    """A frame's seed, opaque.

    Raises
    ------
    ValueError
        If it is no integer from 0 to 2^32 - 1.
    """
    if dr.is_array_v(seed) and dr.is_integral_v(seed):
        if dr.width(seed) != 1:
            raise ValueError(
                f"restir_pt: seed must be a single integer, not an array of {dr.width(seed)}"
            )
        word = mi.UInt32(seed)
        dr.make_opaque(word)
        return word
    return dr.opaque(mi.UInt32, _word("seed", seed))


def checked_spp(spp: Any, sensor: mi.Sensor) -> int:
    """Candidates per pixel; where 0 are asked for, as many as the sensor's sampler has.

    Raises
    ------
    ValueError
        If it is no integer from 0 to 2^32 - 1.
    """
    return _word("spp", spp) or int(sensor.sampler().sample_count())


def _word(name: str, value: Any) -> int:
    try:
        number = -1 if isinstance(value, bool) else operator.index(value)
    except TypeError:
        number = -1
    if not 0 <= number < WORDS:
        raise ValueError(
            f"restir_pt: {name} must be an integer from 0 to {WORDS - 1}, not {value!r}"
        )
    return number


def check_scene(scene: mi.Scene) -> None:
    """Refuse participating media, and more instances than can be told apart.

    Raises
    ------
    ValueError
        If a shape of the scene bounds a medium, or an instance has too large a number or group.
    """
    instances = [shape for shape in scene.shapes() if shape.class_name() == "Instance"]
    for instance in instances:
        count = instance.effective_primitive_count()
        if count > MOST_PRIMITIVES:
            raise ValueError(
                f"restir_pt: instance {instance.id()!r} shows {count} primitives, of "
                f"{MOST_PRIMITIVES} at most; split its shape group"
            )
    if instances:
        largest = int(dr.max(number_of(mi.ShapePtr(instances)))[0])
        if largest > MOST_INSTANCES:
            raise ValueError(
                f"restir_pt: an instance is shape number {largest} of this process, which may be "
                f"{MOST_INSTANCES} at most; let go of other scenes, or use fewer shapes"
            )
    for shape in scene.shapes():
        if shape.is_medium_transition():
            raise ValueError(
                f"restir_pt: shape {shape.id()!r} bounds a participating medium, which is not "
                "supported; remove its interior and exterior media"
            )


def check_sensor(sensor: mi.Sensor, temporal: bool) -> None:
    """Refuse sensors and films without a pixel grid; warn about wide reconstruction filters.

    Warns as well where temporal reuse is asked for and the sensor cannot have it.

    Raises
    ------
    ValueError
        For one-pixel, batch and spectral-film sensors, and sensors inside a medium.
    """
    name, film = sensor.class_name(), sensor.film()
    if "Batch" in name:
        raise ValueError("restir_pt: batch sensors are not supported; render their sensors in turn")
    if name in _ONE_PIXEL or tuple(film.crop_size()) == (1, 1):
        raise ValueError(
            f"restir_pt: {name} with a film of {film.crop_size()} has no neighbouring pixels to "
            "reuse; use a sensor with an image"
        )
    if sensor.get_medium() is not None:
        raise ValueError("restir_pt: the sensor is inside a participating medium; remove it")
    if mi.has_flag(film.flags(), mi.FilmFlags.Special):
        raise ValueError(f"restir_pt: the film {film.class_name()} is not supported; use hdrfilm")
    if not film.rfilter().is_box_filter():
        warnings.warn(
            "restir_pt: the film's reconstruction filter is not 'box'; a wider filter correlates "
            "pixels and defeats denoisers",
            stacklevel=4,
        )
    if temporal and name not in REPROJECTABLE:
        warnings.warn(
            f"restir_pt: {name} cannot be re-projected; rendering without temporal reuse "
            "(use perspective or thinlens to have it)",
            stacklevel=5,
        )
