"""Shading: the displayed colour of a frame and the auxiliary images that come with it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit, camera_ray
from ..paths.vertex import exists
from ..resampling.reservoir import Reservoir

AOV_CHANNELS = {
    "albedo": ("R", "G", "B"),
    "sh_normal": ("X", "Y", "Z"),
    "depth": ("T",),
    "position": ("X", "Y", "Z"),
    "motion": ("X", "Y"),
    "confidence": ("C",),
}
"""Auxiliary images and the suffixes of their channels, as Mitsuba's ``aov`` names them."""


def reservoir_color(reservoir: Reservoir) -> Any:
    """F W: the contribution of the selected path (``Color3f``)."""
    return reservoir.color * reservoir.weight


def auxiliary(names: Sequence[str], hit: PrimaryHit, flow: Any, confidence: Any) -> list[Any]:
    """Channels of the requested auxiliary images, in order, one ``Float`` per channel.

    Parameters
    ----------
    names : sequence of str
        Keys of :data:`AOV_CHANNELS`.
    flow : Vector2f
        Previous minus current film position [pixels].
    confidence : Float
        Confidence weights of the final reservoirs.
    """
    images: dict[str, Any] = {
        "sh_normal": hit.normal,
        "depth": [dr.select(exists(hit.vertex), dr.norm(hit.vertex.p - hit.origin), 0)],
        "position": hit.vertex.p,
        "motion": flow,
        "confidence": [confidence],
    }
    if "albedo" in names:
        ray, pi = camera_ray(hit, dr.zeros(mi.Ray3f).wavelengths)
        si = pi.compute_surface_interaction(ray)
        albedo = si.bsdf().eval_diffuse_reflectance(si, si.is_valid())
        images["albedo"] = albedo if len(albedo) == 3 else [albedo[0]] * 3
    return [mi.Float(channel) for name in names for channel in images[name]]
