"""Shading: the displayed colour of a frame and the auxiliary images that come with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import drjit as dr
import mitsuba as mi

from ..paths.identity import identity
from ..paths.primary_hit import PrimaryHit, camera_ray
from ..paths.spectrum import target
from ..paths.vertex import exists
from ..resampling.reservoir import Reservoir


@dataclass
class Shown:
    """What a frame ends with, one lane per pixel.

    Fields: ``hit``, ``flow`` (previous minus current film position [pixels]), ``reservoirs`` (after
    spatial reuse), ``past`` (the colour history with the light seen directly), ``candidates`` (what
    the frame's candidates alone would show; 0 where no image of them is asked for), ``first_round``
    (what the first round of spatial reuse would show; likewise).
    """

    hit: PrimaryHit
    flow: mi.Vector2f
    reservoirs: Reservoir
    past: mi.Color3f
    candidates: mi.Color3f
    first_round: mi.Color3f

    @cached_property
    def surface(self) -> mi.SurfaceInteraction3f:
        """What the camera sees; several images look at it."""
        ray, pi = camera_ray(self.hit, dr.zeros(mi.Ray3f).wavelengths)
        return pi.compute_surface_interaction(ray)


def _nothing(*_: object) -> list[mi.Float]:
    return []


@dataclass(frozen=True)
class Aov:
    """A type of auxiliary image.

    Attributes
    ----------
    channels : sequence of str
        Suffixes of its channels, as Mitsuba's ``aov`` names them.
    shown : callable
        :class:`Shown` -> its channels, or the last of them.
    moved : callable
        (reservoirs before the mutations, after them) -> the first channels, where what they show is
        gone by the end of the frame.
    doc : str
        What it shows, where its name does not say it.
    selects : bool
        Whether only selection has it.
    """

    channels: Sequence[str]
    shown: Callable[[Shown], Sequence[mi.Float]] = _nothing
    moved: Callable[[Reservoir, Reservoir], Sequence[mi.Float]] = _nothing
    doc: str = ""
    selects: bool = False


def reservoir_color(reservoir: Reservoir) -> mi.Color3f:
    """F W: the contribution of the selected path."""
    return reservoir.color * reservoir.weight


def mutation_luminances(before: Reservoir, after: Reservoir) -> list[mi.Float]:
    """Luminance of F W before and after the mutations, and of the new F with the old W.

    The first two are equal, whatever the acceptance rule.
    """
    pairs = ((before, before), (after, after), (after, before))
    return [target(path.color) * weight.weight for path, weight in pairs]


def path_number(reservoir: Reservoir) -> mi.Float:
    """Identity of the selected path; -1 where there is no path."""
    return dr.select(reservoir.weight > 0, mi.Float(identity(reservoir.path)), -1)


def _albedo(shown: Shown) -> Sequence[mi.Float]:
    si = shown.surface
    albedo = si.bsdf().eval_diffuse_reflectance(si, si.is_valid())
    return albedo if len(albedo) == 3 else [albedo[0]] * 3


def _depth(shown: Shown) -> mi.Float:
    vertex = shown.hit.vertex
    return dr.select(exists(vertex), dr.norm(vertex.p - shown.hit.origin), 0)


AOVS = {
    "albedo": Aov("RGB", _albedo),
    "sh_normal": Aov("XYZ", lambda shown: shown.surface.sh_frame.n),
    "depth": Aov("T", lambda shown: [_depth(shown)]),
    "position": Aov("XYZ", lambda shown: shown.hit.vertex.p),
    "motion": Aov(
        "XY",
        lambda shown: shown.flow,
        doc="previous minus current film position [pixels]",
    ),
    "confidence": Aov("C", lambda shown: [shown.reservoirs.confidence]),
    "candidates": Aov(
        "RGB",
        lambda shown: shown.candidates,
        doc="what the frame's own candidates would show without any reuse",
    ),
    "first_round": Aov(
        "RGB",
        lambda shown: shown.first_round,
        doc="what the first round of spatial reuse would show",
    ),
    "mutation": Aov(
        ("before", "after", "mixed"),
        moved=mutation_luminances,
        doc="luminance of F W before and after the mutations, and of the new F with the old W; "
        "before spatial reuse",
    ),
    "path": Aov(
        ("before", "after", "shown"),
        lambda shown: [path_number(shown.reservoirs)],
        lambda before, after: [path_number(before), path_number(after)],
        doc="number of the path that a pixel holds before and after the mutations and after "
        "spatial reuse, equal for equal paths; -1: none",
    ),
    "history": Aov(
        "RGB",
        lambda shown: shown.past,
        doc="the colour history of ``selection``",
        selects=True,
    ),
}
"""The types of auxiliary images."""


def moved_images(kinds: Sequence[str], before: Reservoir, after: Reservoir) -> list[list[mi.Float]]:
    """Channels of each image that have to be taken before spatial reuse, as ``Float``."""
    return [[mi.Float(c) for c in AOVS[kind].moved(before, after)] for kind in kinds]


def auxiliary(kinds: Sequence[str], moved: list[list[mi.Float]], shown: Shown) -> list[mi.Float]:
    """Channels of the requested auxiliary images, in order, one ``Float`` per channel.

    Parameters
    ----------
    kinds : sequence of str
        Keys of :data:`AOVS`.
    moved : list of lists of Float
        See :func:`moved_images`.
    shown : Shown
    """
    channels = [
        channel
        for kind, first in zip(kinds, moved, strict=True)
        for channel in (*first, *AOVS[kind].shown(shown))
    ]
    return [mi.Float(channel) for channel in channels]
