"""Frame after frame of a scene that moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import mitsuba as mi

from ..analysis import denoise as denoiser
from ..errors import one_line, root
from ..imageio import RGB, Image
from ..integrators.images import asking_for, images_of
from .shot import WARMUP, Shot, seed_from


@dataclass(frozen=True)
class Frame:
    """
    A rendered frame.

    Fields
    ------
    index : int
        Its number; below ``start`` in frames of the warm-up, which are not yielded.
    image : array, (H, W, 3)
        Linear colour.
    layers : mapping
        The auxiliary images of ``aovs`` by name, (H, W, C) each.
    denoised : array, (H, W, 3), or None
    statistics : mapping
        See ``restir_pt``'s ``statistics()``.
    """

    index: int
    image: Image
    layers: Mapping[str, Image] = field(default_factory=dict)
    denoised: Image | None = None
    statistics: Mapping[str, Any] = field(default_factory=dict)


def render(
    scene: mi.Scene,
    frames: int,
    update: Callable[[int], None] | None = None,
    *,
    sensor: int | mi.Sensor = 0,
    spp: int = 1,
    seed: int = 0,
    start: int = 0,
    denoise: bool = False,
    **parameters: Any,
) -> Iterator[Frame]:
    """
    Render frames of a scene that moves, one after the other, as they are asked for.

    Parameters
    ----------
    scene : Scene
    frames : int
        Number of the frame after the last.
    update : callable, optional
        Called with a frame's number before it is rendered, to edit scene and sensor by
        ``mi.traverse``; what :meth:`.animation.Animation.bind` gives is one. Between two frames its
        edits are undone and redone once, as they are stored.
    sensor : int or Sensor
    spp : int
        Candidate paths per pixel and frame.
    seed : int
    start : int
        The first frame that is wanted; up to :data:`.shot.WARMUP` frames before it are rendered
        for their history.
    denoise : bool
        Denoise each frame as well; takes ``preset="denoised"`` where no preset is given.
    **parameters
        Of ``restir_pt``. ``retrace_history`` is on where ``update`` may edit more than sensors.

    Returns
    -------
    iterator of Frame
        Each is rendered when it is asked for.

    Raises
    ------
    ValueError
        An argument is not allowed, or the integrator refuses it.
    ImportError
        Denoised frames are asked for, and the denoiser is not installed.
    """
    if frames < 1 or not 0 <= start < frames:
        raise ValueError(f"there is no frame {start} among {frames}")
    aovs = dict(images_of(str(parameters.pop("aovs", ""))))
    if denoise:
        denoiser.require()
        parameters = {"preset": "denoised", **parameters}
    edits = update is not None and getattr(update, "edits_scene", True)
    parameters = {"retrace_history": edits, **parameters}
    guides = {f"denoiser_{kind}": kind for kind in denoiser.GUIDES} if denoise else {}
    if wanted := {**aovs, **guides}:
        parameters["aovs"] = asking_for(wanted)
    try:
        integrator = mi.load_dict({"type": "restir_pt", **parameters})
    except RuntimeError as error:
        raise ValueError(one_line(root(error))) from error
    if not isinstance(sensor, mi.Sensor):
        sensor = scene.sensors()[sensor]
    first = max(0, start - WARMUP)
    shot = Shot(scene, sensor, integrator, update, spp, seed_from(seed, first))
    return _frames(shot, range(first, frames), start, tuple(aovs), tuple(guides))


def _frames(
    shot: Shot, indices: range, start: int, aovs: Sequence[str], guides: Sequence[str]
) -> Iterator[Frame]:
    """The frames from ``start`` on; ``guides`` are the layers that the denoiser takes, if any."""
    for index in indices:
        image = shot.image(index)
        if index < start:
            continue
        layers = _layers(image, shot.integrator.aov_names())
        colour = image[..., : len(RGB)]
        clean = None
        if guides:
            clean = denoiser.denoise_guided(colour, *(layers[name] for name in guides))
        shown = {name: layers[name] for name in aovs}
        yield Frame(index, colour, shown, clean, shot.integrator.statistics())


def _layers(image: Image, channels: list[str]) -> dict[str, Image]:
    """The auxiliary images by name, of a frame with these channels after the colour."""
    found: dict[str, list[int]] = {}
    for place, channel in enumerate(channels, len(RGB)):
        found.setdefault(channel.rpartition(".")[0], []).append(place)
    return {name: image[..., places] for name, places in found.items()}
