"""What of a frame is shown: each view is one function from a shot to a picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from ..analysis.colours import diverging, sequential
from ..analysis.denoise import denoise_guided, installed
from ..analysis.duplication import copies
from ..analysis.images import FloatArray, luminance
from ..guiding.cells import cell_at
from ..guiding.guide import alpha_at
from ..guiding.steering import steerable
from ..imageio import Image, to_srgb8
from ..integrators.recording import frame_alone
from ..mutations.pivot import MutationClass
from .camera import project
from .encode import Picture
from .model import COLOUR, Side
from .reference import Reference
from .renderer import Shot

NEIGHBOURHOOD = 3
"""Radius [pixels] in which copies of a pixel's path are counted."""

FULL_ERROR = 1.0
"""Relative error with the fullest colour."""


@dataclass(frozen=True)
class Drawn:
    """
    A picture and what its colours mean.

    Attributes
    ----------
    picture : array, (H, W, 3)
    scale : str
        Often nothing.
    image : array, (H, W, 3), or None
        The linear colour that it shows, or shows the error of.
    """

    picture: Picture
    scale: str = ""
    image: Image | None = None


@dataclass(frozen=True)
class View:
    """
    A way to look at a frame.

    Attributes
    ----------
    title : str
    draw : callable
        (shot, exposure [stops], reference) -> `Drawn`.
    missing : callable
        (side, reference) -> why there is nothing to see, or an empty text.
    still : bool
        Whether it can be shown of the mean of many frames.
    """

    title: str
    draw: Callable[[Shot, float, Reference | None], Drawn]
    missing: Callable[[Side, Reference | None], str] = lambda side, reference: ""
    still: bool = False


def colour(image: Image, exposure: float) -> Drawn:
    """Linear colour on the screen, brighter by so many stops."""
    return Drawn(_displayed(image, exposure), image=image)


def error(image: Image, reference: Reference) -> Drawn:
    """Relative error of the luminance: blue is too dark, red too bright."""
    relative = relative_error(image, reference)
    picture = diverging(relative / FULL_ERROR)
    return Drawn(picture, "blue −100 %, white 0, red +100 %", image)


def relative_error(image: Image, reference: Reference) -> FloatArray:
    """Error of the luminance over the smoothed reference, (H, W); 0 where it is not finite."""
    found = np.nan_to_num(image, posinf=0.0, neginf=0.0)
    return (luminance(found) - reference.luminance) / reference.scale


def _denoised(shot: Shot, exposure: float, _: Reference | None) -> Drawn:
    albedo, normal = (shot.auxiliary(kind) for kind in ("albedo", "sh_normal"))
    return colour(denoise_guided(shot.image, albedo, normal), exposure)


def _normal(shot: Shot, *_: object) -> Drawn:
    normal = 0.5 * shot.auxiliary("sh_normal") + 0.5
    return Drawn(_bytes(normal), "x red, y green, z blue")


def _depth(shot: Shot, *_: object) -> Drawn:
    return _heat(shot.auxiliary("depth")[..., 0], "{} units")


def moved(shot: Shot) -> FloatArray:
    """Where surfaces were, minus where they are on the film, (H, W, 2) [pixels]; by the camera."""
    if shot.pose is None or shot.before is None:
        return np.zeros((*shot.image.shape[:2], 2))
    points = shot.auxiliary("position").astype(np.float64)
    hit = shot.auxiliary("depth") > 0
    flow = project(shot.before, points, shot.size) - project(shot.pose, points, shot.size)
    return np.where(hit, np.nan_to_num(flow), 0.0)


def _motion(shot: Shot, *_: object) -> Drawn:
    flow = moved(shot)
    most = nice(float(np.abs(flow).max()))
    x, y = np.moveaxis(0.5 + 0.5 * flow / most, -1, 0)
    scale = f"right red, down green, full colour {most:g} pixels" if flow.any() else "at rest"
    return Drawn(_bytes(np.stack([x, y, np.full_like(x, 0.5)], axis=-1)), scale)


def _confidence(shot: Shot, *_: object) -> Drawn:
    return _heat(shot.auxiliary("confidence")[..., 0], "{} candidates")


def _duplication(shot: Shot, *_: object) -> Drawn:
    identities = shot.auxiliary("path")[..., -1].astype(np.int64)
    found = copies(identities, NEIGHBOURHOOD)
    window = (2 * NEIGHBOURHOOD + 1) ** 2 - 1
    return _heat(found.astype(np.float64), f"{{}} of {window} neighbours have the pixel's path")


def _acceptance(shot: Shot, *_: object) -> Drawn:
    mutated = shot.frame.mutated
    assert mutated is not None
    with frame_alone():
        tried = mutated.kind < len(MutationClass.names())
        accepted = mi.Float(mutated.accepted) / float(shot.side.value("mutations"))
        share = shot.channels([dr.select(tried, accepted, dr.nan)])
    return Drawn(sequential(share[..., 0]), "dark none, bright all mutations accepted")


def _guide(shot: Shot, *_: object) -> Drawn:
    learnt, hits = shot.frame.history.learnt, shot.frame.history.hits
    assert learnt is not None
    assert learnt.guide is not None
    with frame_alone():
        there = hits.vertex.shape != None  # noqa: E711  (element-wise)
        cell = cell_at(learnt.cells, hits.vertex.p, hits.normal)
        steered = there & steerable(hits.vertex.shape.bsdf())
        share = shot.channels([1 - alpha_at(learnt.guide, cell, mi.UInt32(1), steered)])
    return Drawn(sequential(share[..., 0]), "share of first directions that the guide draws")


def _error(shot: Shot, _: float, reference: Reference | None) -> Drawn:
    assert reference is not None
    return error(shot.image, reference)


def _bytes(values: npt.NDArray[np.floating]) -> Picture:
    return (255 * np.clip(values, 0, 1)).astype(np.uint8)


def _displayed(image: Image, exposure: float) -> Picture:
    return to_srgb8(image * np.float32(2.0**exposure))


def _heat(values: npt.NDArray[np.floating], unit: str) -> Drawn:
    values = np.nan_to_num(values, posinf=0.0)
    most = nice(float(values.max()))
    return Drawn(sequential(values / most), f"bright: {unit.format(f'{most:g}')}")


def nice(largest: float) -> float:
    """The next of 1, 2, 5, 10, 20, ...: a scale that stays the same while values change a little.

    Parameters
    ----------
    largest : float
        Not negative; 0 has the scale 1.
    """
    if not largest > 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(largest))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= largest)


def _without_guide(side: Side, _: Reference | None) -> str:
    return "" if side.value("guiding") else "Guide: set guiding"


def _without_all_mutated(side: Side, _: Reference | None) -> str:
    if not side.value("mutations"):
        return "Acceptance of mutations: set mutations"
    return (
        ""
        if side.value("mutation_interval") == 1
        else ("Acceptance of mutations: set mutation_interval to 1, so that every pixel has some")
    )


def _without_denoiser(*_: object) -> str:
    return "" if installed() else "Denoised: needs pip install 'mitsuba-restir[denoise]'"


def _without_reference(_: Side, reference: Reference | None) -> str:
    return (
        ""
        if reference
        else "Error: there is no reference of this view; let it rest, then keep it as the reference"
    )


def _plain(shot: Shot, exposure: float, _: Reference | None) -> Drawn:
    return colour(shot.image, exposure)


def _albedo(shot: Shot, *_: object) -> Drawn:
    return Drawn(_displayed(shot.auxiliary("albedo"), 0.0))


VIEWS = {
    COLOUR: View("Colour", _plain, still=True),
    "denoised": View("Denoised", _denoised, _without_denoiser, still=True),
    "albedo": View("Albedo", _albedo),
    "normal": View("Normals", _normal),
    "depth": View("Depth", _depth),
    "motion": View("Motion", _motion),
    "confidence": View("Confidence", _confidence),
    "duplication": View("Duplicated paths", _duplication),
    "acceptance": View("Acceptance of mutations", _acceptance, _without_all_mutated),
    "guide": View("Guide", _guide, _without_guide),
    "error": View("Error", _error, _without_reference, still=True),
}
"""The views by name."""
