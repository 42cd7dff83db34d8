"""From a study to images: the scene, the camera, and one renderer for each variant."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...analysis.denoise import GUIDES, denoise_guided
from ...errors import UsageError, one_line
from ...integrators.images import asking_for
from ...transforms import TO_WORLD, look_at, matrix_of
from ..config.study import Crop, Size, Study, Variant
from ..config.view import View
from .motion import make_place
from .results import Image
from .stills import TYPE, Stills

# Plugins of cameras that can be copied, and the parameters that are theirs alone.
_COPIED = {
    "PerspectiveCamera": (
        "perspective",
        ("principal_point_offset_x", "principal_point_offset_y"),
    ),
    "ThinLensCamera": ("thinlens", ("aperture_radius", "focus_distance")),
}
_SHOWN = "shown"


@dataclass(frozen=True)
class Renderer:
    """
    Renders frame after frame of one variant.

    Fields
    ------
    draw : callable
        Renders one frame with a seed.
    reset : callable
        Forgets the history.
    has_history : bool
        Frames depend on earlier ones.
    place : callable or None
        Moves camera and light to where they are so many frames before the last.
    statistics, history : callable or None
        What the integrator says about its last frame, and what it keeps for the next one.
    channel : int
        The first of the three channels that are taken as the frame.
    rehearsal : int
        Frames that compile all kernels: one, and where they are recorded or those of a frame with
        history are others, three.
    stills : Stills or None
        What says of the last frame what a still states, where the frames are stills.
    """

    draw: Callable[[int], Any]
    reset: Callable[[], None]
    has_history: bool
    place: Callable[[int], None] | None = None
    statistics: Callable[[], Mapping[str, Any]] | None = None
    history: Callable[[], Any] | None = None
    channel: int = 0
    rehearsal: int = 3
    stills: Stills | None = None

    def frame_before_last(self, seed: int, frames: int) -> tuple[Image, float]:
        """Render the frame that comes so many frames before the last one."""
        if self.place is not None:
            self.place(frames)
        return self.frame(seed)

    def frame(self, seed: int) -> tuple[Image, float]:
        """
        Render one frame.

        Returns
        -------
        image : array, (H, W, 3)
        seconds : float
            Until the image is computed, without its way to NumPy.
        """
        dr.sync_thread()
        begin = time.perf_counter()
        tensor = self.draw(seed)
        dr.eval(tensor)
        dr.sync_thread()
        seconds = time.perf_counter() - begin
        first = self.channel
        return np.array(tensor, dtype=np.float32)[..., first : first + 3], seconds


# First entries of the seed keys: references share no random numbers with runs.
RUN_KEY, REFERENCE_KEY, REHEARSAL_KEY = 0, 1, 2

# Russian roulette saves time but adds variance, which the deepest paths feel most.
ENDLESS = {"rr_depth": 1_000_000}
"""Of a reference: paths go on until `max_depth`."""


def seed_of(study_seed: int, *key: int) -> int:
    """Return the 32-bit seed of a frame; different keys give independent seeds."""
    return int(np.random.SeedSequence(study_seed, spawn_key=key).generate_state(1)[0])


def make_sensor(study: Study, scene: Any, size: Size) -> Any:
    """
    Make the study's camera: the view, or a copy of the scene's first camera, with a box filter.

    A wider reconstruction filter would correlate pixels, and be measured as covariance.

    Raises
    ------
    UsageError
        The scene's camera cannot be copied.
    """
    film = {
        "type": "hdrfilm",
        **_window(study.crop, size),
        "pixel_format": "rgb",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }
    common = {"film": film, "sampler": {"type": "independent"}, "fov_axis": "x"}
    view = study.view
    if view is not None:
        return mi.load_dict(
            {"type": "perspective", "fov": view.fov, TO_WORLD: _seen(view), **common}
        )
    sensors = scene.sensors()
    kind = sensors[0].class_name() if sensors else ""
    if kind not in _COPIED:
        raise UsageError(f"{study.name}: the scene has no perspective camera: give a [view]")
    plugin, own = _COPIED[kind]
    values = mi.traverse(sensors[0])
    names = {"fov": "x_fov", **{name: name for name in ("near_clip", "far_clip", *own)}}
    numbers = {name: float(np.ravel(values[key])[0]) for name, key in names.items()}
    matrix = matrix_of(values)
    transform = mi.ScalarTransform4f(matrix)
    return mi.load_dict({"type": plugin, TO_WORLD: transform, **numbers, **common})


def _window(crop: Crop | None, size: Size) -> dict[str, int]:
    """Return size and crop window of a film whose window has `size` pixels."""
    if crop is None:
        return {"width": size[0], "height": size[1]}
    left, top, *shares = crop
    whole = [max(round(n / share), n) for n, share in zip(size, shares, strict=True)]
    # Rounding must not push the window over the edge.
    x, y = (
        min(round(start * n), n - part)
        for start, n, part in zip((left, top), whole, size, strict=True)
    )
    return {
        "width": whole[0],
        "height": whole[1],
        "crop_offset_x": x,
        "crop_offset_y": y,
        "crop_width": size[0],
        "crop_height": size[1],
    }


def make_integrator(study: Study, name: str, variant: Variant) -> Any:
    """
    Make a variant's integrator.

    Raises
    ------
    UsageError
        The plugin or one of its parameters does not exist, or a value is refused.
    """
    parameters: dict[str, Any] = {"max_depth": study.max_depth, **variant.parameters}
    if variant.shows:
        others = parameters.get("aovs", "")
        parameters["aovs"] = f"{_SHOWN}:{variant.shows}" + (f", {others}" if others else "")
    try:
        integrator = mi.load_dict({"type": variant.type, **parameters})
    except (RuntimeError, ValueError, TypeError) as error:
        raise UsageError(f"{study.name}: variant '{name}': {one_line(error)}") from error
    if variant.shows:
        channels = [c for c in integrator.aov_names() if c.startswith(f"{_SHOWN}.")]
        if len(channels) != 3:
            raise UsageError(
                f"{study.name}: variant '{name}' cannot show '{variant.shows}': it has "
                f"{len(channels)} channels, not 3"
            )
    return integrator


def make_renderer(study: Study, scene: Any, size: Size, name: str, variant: Variant) -> Renderer:
    """
    Make what renders a variant at one size.

    Raises
    ------
    UsageError
        As `make_integrator` and `make_sensor`.
    """
    sensor = make_sensor(study, scene, size)
    place = make_place(study, scene, sensor)
    if variant.type == TYPE:
        stills = Stills(study, scene, sensor, name, variant)
        return Renderer(stills.draw, _nothing, False, place, rehearsal=1, stills=stills)
    integrator = make_integrator(study, name, variant)
    renderer = renderer_of(scene, sensor, integrator, variant.spp, study.freeze)
    renderer = replace(renderer, place=place, channel=3 if variant.shows else 0)
    return denoising(renderer, scene, sensor) if variant.denoise else renderer


def denoising(renderer: Renderer, scene: Any, sensor: Any) -> Renderer:
    """Have every frame denoised, with guides that are free of noise and take no time."""
    guides = denoiser_guides(scene, sensor)
    first = renderer.channel

    def draw(seed: int) -> Image:
        colour = np.array(renderer.draw(seed), dtype=np.float32)[..., first : first + 3]
        return denoise_guided(colour, *guides)

    return replace(renderer, draw=draw, channel=0)


def renderer_of(
    scene: Any, sensor: Any, integrator: Any, spp: int, freeze: bool = True
) -> Renderer:
    """Make what renders with an integrator; one without a history is recorded once if wanted."""

    def render(scene: Any, sensor: Any, seed: Any) -> Any:
        # Calling the integrator's own `render` in a frozen function would run the paths a second
        # time, to leave the sampler's state behind: measured 1.65 times the time of `mi.render`.
        return mi.render(scene, integrator=integrator, sensor=sensor, spp=spp, seed=seed)

    reset = getattr(integrator, "reset", None)
    if reset is not None:
        return Renderer(
            partial(render, scene, sensor),
            reset,
            has_history=True,
            statistics=getattr(integrator, "statistics", None),
            history=lambda: integrator._history,
        )
    draw = dr.freeze(render) if freeze else render

    def draw_anew(seed: int) -> Any:
        # A literal seed would be compiled into the kernel, and every frame would compile anew.
        return draw(scene, sensor, dr.opaque(mi.UInt32, seed))

    return Renderer(draw_anew, _nothing, has_history=False, rehearsal=3 if freeze else 1)


_SEEN = 64
"""Samples of what guides a denoiser: enough to be free of noise."""


def denoiser_guides(scene: Any, sensor: Any) -> tuple[Image, Image]:
    """Render what the denoiser is guided by where an integrator has none: albedo and normals."""
    aovs = asking_for({kind: kind for kind in GUIDES})
    integrator = mi.load_dict({"type": "aov", "aovs": aovs})
    film = mi.render(scene, integrator=integrator, sensor=sensor, spp=_SEEN)
    albedo, normal = np.split(np.array(film, dtype=np.float32)[..., -6:], 2, axis=-1)
    return albedo, normal


def _nothing() -> None:
    """Reset an integrator that has no history."""


def _seen(view: View) -> Any:
    return mi.ScalarTransform4f(look_at(view.origin, view.target, view.up))
