"""The ``restir_pt`` plugin: ReSTIR path tracing as a Mitsuba integrator."""

from __future__ import annotations

import inspect
import warnings
from dataclasses import replace
from typing import Any, NoReturn, SupportsIndex

import drjit as dr
import mitsuba as mi

from ..neighbors.strategies import STRATEGIES
from ..passes.primary import primary
from ..passes.shade import AOVS
from ..paths.camera import REPROJECTABLE, Camera, copy_camera
from ..paths.grid import grid_of
from ..paths.settings import PathLimits
from ..sampling.dither import Dither, mask_texture
from ..sampling.masks import load_mask
from ..sampling.streams import FrameKey
from ..shifts.connectability import Criterion, DistanceRoughness, Footprint
from ..shifts.mapping import ShiftMapping, shift_mapping
from .border import (
    WORDS,
    check_same_variant,
    check_scene,
    check_sensor,
    check_variant,
    checked_seed,
    checked_spp,
)
from .declaration import page
from .frame import Frame, History, Plan, Setting, no_history, sample_paths, share_paths
from .parameters import PARAMETERS, Parameters, read_parameters
from .recording import Stage, collection_paused
from .statistics import mutation_shares, outcome_shares, refused_count

NEAR_FRACTION = 0.03
"""Distance threshold of ``distance_roughness`` as a fraction of the scene's radius."""


class ReSTIRPTIntegrator(mi.CppADIntegrator):
    r"""
    .. _integrator-restir_pt:

    ReSTIR path tracer (:monosp:`restir_pt`)
    ----------------------------------------

    {parameters}

    Renders with generalised resampled importance sampling (Lin et al. 2022): the candidate paths of
    a pixel are resampled together with those of its neighbours and of earlier frames. One call of
    :py:func:`mitsuba.render` renders one frame, and ``spp`` is the number of candidate paths per
    pixel and frame. The history stays in the integrator until :py:meth:`reset`, or until the scene,
    the film size or the kind of sensor changes.

    - Every mode that is not named biased converges to the image of ``path``; frames of one sequence
      are correlated.
    - A pixel's candidates share one sub-pixel (and lens) position per frame, so antialiasing comes
      from averaging frames.
    - Use a ``box`` reconstruction filter: a wider one correlates pixels and defeats denoisers.
    - ``perspective`` and ``thinlens`` sensors have all reuse, other sensors spatial reuse only.
    - A camera path that has only passed through null lobes when it leaves the scene keeps the
      light that it found on surfaces. ``path`` drops it where no environment is shown, so that a
      mask lit by a lamp is too dark by the mask's opacity.
    - Participating media and polarized or scalar variants are not supported.

    .. tabs::

        .. code-tab:: xml

            <integrator type="restir_pt">
                <integer name="max_depth" value="8"/>
            </integrator>

        .. code-tab:: python

            'type': 'restir_pt',
            'max_depth': 8
    """

    def __init__(self, props: mi.Properties) -> None:
        self._variant = check_variant()
        super().__init__(props)
        self.parameters = read_parameters(props)
        self._scene: mi.Scene | None = None
        self._shape: tuple[str, int, int] | None = None
        self._plan: Plan | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the history: the next frame starts from nothing."""
        self._history: History | None = None
        self._camera: Camera | None = None
        self._frame: Frame | None = None
        self._sample = 0
        self._turn = 0

    def render(
        self,
        scene: mi.Scene,
        sensor: int | mi.Sensor = 0,
        seed: int | mi.UInt32 = 0,
        spp: int = 0,
        develop: bool = True,
        evaluate: bool = True,
    ) -> mi.TensorXf:
        """Render one frame.

        Parameters
        ----------
        seed : int or UInt32
            Seed of the frame, from 0 to 2^32 - 1. Frames with equal seeds still differ: their
            running number is hashed with it.
        spp : int
            Candidate paths per pixel (0: the sensor's sampler decides).

        Returns
        -------
        mi.TensorXf
            The developed film, shape (height, width, channels).

        Raises
        ------
        ValueError
            For a scene, sensor or film that the integrator cannot render, a seed or an ``spp`` that
            is out of range, and what belongs to another variant than the integrator.
        """
        if not develop:
            raise ValueError("restir_pt: develop=False is not supported; a call returns one frame")
        if isinstance(sensor, int):
            sensor = scene.sensors()[sensor]
        check_same_variant(self._variant, scene, sensor)
        spp = checked_spp(spp, sensor)
        with dr.suspend_grad():
            self._prepare(scene, sensor)
            self._frame = None
            key = FrameKey(dr.opaque(mi.UInt32, self._sample), checked_seed(seed))
            skip_emitters = self.skip_area_emitters if self.parameters.hide_emitters else None
            # The camera rays stay outside the frozen part: not every sensor of Mitsuba 3.9 exposes
            # all of its state to it.
            grid = grid_of(*sensor.film().crop_size())
            now = primary(scene, sensor, grid, key, skip_emitters)
            dr.eval(now)
            setting = Setting(scene, sensor if mi.is_spectral else None, now, key, self._dither)
            with collection_paused():
                sampled = self._sample_paths(
                    setting, self._history, self._camera, dr.opaque(mi.UInt32, spp)
                )
                # The old history is released here, so that it does not count at the frame's peak.
                self._history = None
                turn = dr.opaque(mi.UInt32, self._turn)
                frame = self._share_paths(setting, sampled, self._layout, turn)
            self._history = frame.history
            if self._camera is not None:
                self._camera = copy_camera(sensor)
            self._sample = (self._sample + spp) % WORDS
            self._turn = (self._turn + 1) % WORDS
            self._frame = frame
            return self._develop(sensor.film(), frame)

    def aov_names(self) -> list[str]:
        """Names of the auxiliary channels, in film order."""
        return [
            f"{name}.{suffix}"
            for name, kind in self.parameters.images
            for suffix in AOVS[kind].channels
        ]

    def statistics(self) -> dict[str, Any]:
        """What the last frame's reuse did.

        Returns
        -------
        dict
            ``matched``: share of pixels that found their history. ``not_finite``: how many
            candidates, shifts and merges were not finite; none of them gets into a reservoir, and a
            candidate is shown in its own frame as ``path`` would show it. One entry per reuse pass
            (``temporal``, ``spatial_0``, ...): the share of shifts by outcome, of those that had
            something to shift. ``mutations``: per class of path, its share of the pixels that had
            their turn, the acceptance rate, the shares of the accepted mutations that raise and
            that lower the target function, and the mean accepted change of direction [rad].
            ``biased``: parameters that bias the image, if there are any.
        """
        if self._frame is None:
            raise ValueError("restir_pt: there are no statistics before the first frame")
        temporal, *rounds = self._frame.outcomes
        shares = {"temporal": outcome_shares(temporal, 2)} if temporal else {}
        for index, packed in enumerate(rounds):
            shares[f"spatial_{index}"] = outcome_shares(packed, 1)
        refused = int(self._frame.refused[0]) + refused_count(self._frame.outcomes)
        statistics = {
            "matched": float(dr.mean(mi.Float(self._frame.matched))[0]),
            "not_finite": refused,
            **shares,
        }
        if self._frame.mutated is not None:
            statistics["mutations"] = mutation_shares(
                self._frame.mutated, self.parameters.mutations
            )
        if self.parameters.biased:
            statistics["biased"] = list(self.parameters.biased)
        return statistics

    def to_string(self) -> str:
        """The integrator and its parameters as text."""
        biased = ", ".join(self.parameters.biased)
        note = f", biased by {biased}" if biased else ""
        return f"ReSTIRPTIntegrator[{self.parameters}{note}]"

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        """Refuse to be copied or pickled: a history is on the device, and recorded for it."""
        raise TypeError(
            "restir_pt: an integrator holds the history of its frames and cannot be copied or "
            "pickled; make another one with mi.load_dict"
        )

    def _prepare(self, scene: mi.Scene, sensor: mi.Sensor) -> None:
        """Check the inputs and start a new history where the old one does not fit."""
        width, height = sensor.film().crop_size()
        shape = (sensor.class_name(), width, height)
        if scene is not self._scene or shape != self._shape:
            self._plan_frames(scene, sensor, shape)
        if self._history is None:
            self._history = no_history(width * height, self.parameters)
            self._camera = copy_camera(sensor) if shape[0] in REPROJECTABLE else None

    def _plan_frames(self, scene: mi.Scene, sensor: mi.Sensor, shape: tuple[str, int, int]) -> None:
        """Check a new scene or sensor and prepare to render its frames."""
        check_scene(scene)
        check_sensor(sensor)
        parameters = self.parameters
        if parameters.temporal and shape[0] not in REPROJECTABLE:
            warnings.warn(
                f"restir_pt: {shape[0]} cannot be re-projected; rendering without temporal reuse "
                "(use perspective or thinlens to have it)",
                stacklevel=4,
            )
        self.reset()
        self._scene, self._shape = scene, shape
        strategy = STRATEGIES[parameters.neighbor_sampling]
        self._layout = strategy.layout(parameters.spatial_radius)
        dr.make_opaque(self._layout)
        self._dither = _dither() if parameters.blue_noise_seeds else None
        self._plan = Plan(
            parameters,
            PathLimits(parameters.longest, parameters.rr_depth),
            _mapping(parameters, scene),
            shape[1],
            shape[2],
        )
        self._sample_paths = Stage(sample_paths, self._plan)
        self._share_paths = Stage(share_paths, self._plan)

    def _develop(self, film: mi.Film, frame: Frame) -> mi.TensorXf:
        film.prepare(self.aov_names())
        block = film.create_block()
        block.set_coalesce(False)
        grid = grid_of(*film.crop_size())
        x, y = grid.place(grid.pixels())
        center = mi.Point2f(x, y) + 0.5 + mi.Vector2f(film.crop_offset())
        alpha = [frame.alpha] if mi.has_flag(film.flags(), mi.FilmFlags.Alpha) else []
        block.put(center, [*frame.color, *alpha, mi.Float(1), *frame.auxiliary])
        film.put_block(block)
        return film.develop()


def _dither() -> Dither:
    """Dithering of the candidates' numbers by the ready-made mask."""
    dither = Dither(mask_texture(load_mask()))
    dr.make_opaque(dither.mask.levels)
    return dither


def _mapping(parameters: Parameters, scene: mi.Scene) -> ShiftMapping:
    mapping = shift_mapping(parameters.shift, _criterion(parameters.connectability, scene))
    return replace(mapping, hides_sky=parameters.hide_emitters)


def _criterion(name: str, scene: mi.Scene) -> Criterion:
    if name == "footprint":
        return Footprint()
    return DistanceRoughness(NEAR_FRACTION * float(dr.norm(scene.bbox().extents())) / 2)


# The table of the reference page is written from the declarations.
ReSTIRPTIntegrator.__doc__ = inspect.cleandoc(ReSTIRPTIntegrator.__doc__ or "").replace(
    "{parameters}", page(PARAMETERS.values())
)

mi.register_integrator("restir_pt", ReSTIRPTIntegrator)
