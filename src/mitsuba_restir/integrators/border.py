"""The border: what ``restir_pt`` cannot render is refused in one line that says what to do."""

from __future__ import annotations

import warnings

import mitsuba as mi

_ONE_PIXEL = ("RadianceMeter", "IrradianceMeter", "FluxMeter", "DistantSensorImpl")


def check_variant() -> None:
    """Refuse scalar and polarized variants.

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


def check_scene(scene: mi.Scene) -> None:
    """Refuse participating media.

    Raises
    ------
    ValueError
        If a shape of the scene bounds a medium.
    """
    for shape in scene.shapes():
        if shape.is_medium_transition():
            raise ValueError(
                f"restir_pt: shape {shape.id()!r} bounds a participating medium, which is not "
                "supported; remove its interior and exterior media"
            )


def check_sensor(sensor: mi.Sensor) -> None:
    """Refuse sensors and films without a pixel grid; warn about wide reconstruction filters.

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
