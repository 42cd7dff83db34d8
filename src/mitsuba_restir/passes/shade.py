"""Shading: the displayed colour of a frame and the auxiliary images that come with it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.identity import identity
from ..paths.primary_hit import PrimaryHit, camera_ray
from ..paths.spectrum import target
from ..paths.vertex import exists
from ..resampling.reservoir import Reservoir

AOV_CHANNELS = {
    "albedo": ("R", "G", "B"),
    "sh_normal": ("X", "Y", "Z"),
    "depth": ("T",),
    "position": ("X", "Y", "Z"),
    "motion": ("X", "Y"),
    "confidence": ("C",),
    "mutation": ("before", "after", "mixed"),
    "path": ("before", "after", "shown"),
    "history": ("R", "G", "B"),
}
"""Auxiliary images and the suffixes of their channels, as Mitsuba's ``aov`` names them."""


def reservoir_color(reservoir: Reservoir) -> Any:
    """F W: the contribution of the selected path (``Color3f``)."""
    return reservoir.color * reservoir.weight


def mutation_luminances(before: Reservoir, after: Reservoir) -> list[Any]:
    """Luminance of F W before and after the mutations, and of the new F with the old W.

    The first two are equal, whatever the acceptance rule.
    """
    pairs = ((before, before), (after, after), (after, before))
    return [target(path.color) * weight.weight for path, weight in pairs]


def path_number(reservoir: Reservoir) -> Any:
    """Identity of the selected path as a ``Float``; -1 where there is no path."""
    return dr.select(reservoir.weight > 0, mi.Float(identity(reservoir.path)), -1)


def auxiliary(
    names: Sequence[str],
    hit: PrimaryHit,
    flow: Any,
    confidence: Any,
    mutation: list[Any],
    history: Any,
    paths: list[Any],
) -> list[Any]:
    """Channels of the requested auxiliary images, in order, one ``Float`` per channel.

    Parameters
    ----------
    names : sequence of str
        Keys of :data:`AOV_CHANNELS`.
    flow : Vector2f
        Previous minus current film position [pixels].
    confidence : Float
        Confidence weights of the final reservoirs.
    mutation : list of Float
        See :func:`mutation_luminances`; empty where it is not wanted.
    history : Color3f
        The colour history, with the light seen directly.
    paths : list of Float
        See :func:`path_number`: before and after the mutations, and after spatial reuse; empty
        where they are not wanted.
    """
    images: dict[str, Any] = {
        "sh_normal": hit.normal,
        "depth": [dr.select(exists(hit.vertex), dr.norm(hit.vertex.p - hit.origin), 0)],
        "position": hit.vertex.p,
        "motion": flow,
        "confidence": [confidence],
        "mutation": mutation,
        "history": history,
        "path": paths,
    }
    if "albedo" in names:
        ray, pi = camera_ray(hit, dr.zeros(mi.Ray3f).wavelengths)
        si = pi.compute_surface_interaction(ray)
        albedo = si.bsdf().eval_diffuse_reflectance(si, si.is_valid())
        images["albedo"] = albedo if len(albedo) == 3 else [albedo[0]] * 3
    return [mi.Float(channel) for name in names for channel in images[name]]
