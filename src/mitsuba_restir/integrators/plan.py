"""What stays the same from frame to frame, made of the parameters and the scene."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi

from ..paths.packing import fits_compact
from ..paths.record import Form
from ..paths.settings import PathLimits
from ..sampling.dither import Dither, mask_texture
from ..sampling.masks import load_mask
from ..shifts.connectability import Criterion, DistanceRoughness, Footprint
from ..shifts.mapping import shift_mapping
from .frame_data import Plan
from .parameters import Parameters

NEAR_FRACTION = 0.03
"""Distance threshold of ``distance_roughness`` as a fraction of the scene's radius."""


def plan_of(
    parameters: Parameters, scene: mi.Scene, size: tuple[int, int], keeps_rounds: bool
) -> Plan:
    """The plan of a history of frames of a size [pixels], in the scene as it is."""
    limits = PathLimits(parameters.longest, parameters.rr_depth)
    mapping = shift_mapping(parameters.shift, _criterion(parameters.connectability, scene))
    mapping = replace(mapping, hides_sky=parameters.hide_emitters)
    form = Form(parameters.mutates, fits_compact(scene), parameters.blue_noise_seeds)
    return Plan(parameters, limits, mapping, form, *size, keeps_rounds)


def dither_of(parameters: Parameters) -> Dither | None:
    """Dithering of the candidates' numbers by the ready-made mask, if it was asked for."""
    if not parameters.blue_noise_seeds:
        return None
    dither = Dither(mask_texture(load_mask()))
    dr.make_opaque(dither.mask.levels)
    return dither


def _criterion(name: str, scene: mi.Scene) -> Criterion:
    if name == "footprint":
        return Footprint()
    return DistanceRoughness(NEAR_FRACTION * float(dr.norm(scene.bbox().extents())) / 2)
