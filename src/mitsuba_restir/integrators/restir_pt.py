"""The ``restir_pt`` plugin: ReSTIR path tracing as a Mitsuba integrator."""

from __future__ import annotations

import inspect
from dataclasses import replace
from typing import Any, NoReturn, SupportsIndex

import drjit as dr
import mitsuba as mi

from ..neighbors.strategies import layouts
from ..passes.shade import AOVS
from ..paths.camera import REPROJECTABLE, Camera, copy_camera
from ..paths.packing import fits_compact
from ..paths.spectrum import sensitivity, spectra_of
from ..sampling.streams import FrameKey
from .border import (
    WORDS,
    check_same_variant,
    check_scene,
    check_sensor,
    check_variant,
    checked_seed,
    checked_spp,
)
from .change import Change
from .declaration import page
from .film import developed, settle
from .frame_data import Frame, History, Plan, no_history, without_reshaped
from .parameters import PARAMETERS, read_parameters
from .plan import dither_of, plan_of
from .recording import collection_paused, frame_alone
from .scene_watch import Edit, SceneWatch
from .stages import Stages
from .state import State
from .statistics import frame_statistics


class ReSTIRPTIntegrator(mi.CppADIntegrator):
    r"""
    .. _integrator-restir_pt:

    ReSTIR path tracer (:monosp:`restir_pt`)
    ----------------------------------------

    {parameters}

    Renders with generalised resampled importance sampling :cite:p:`Lin2022`: the candidate paths of
    a pixel are resampled together with those of its neighbours and of earlier frames. One call of
    :py:func:`mitsuba.render` renders one frame, and ``spp`` is the number of candidate paths per
    pixel and frame. The history stays in the integrator until :py:meth:`reset`, or until the scene,
    the film size or the kind of sensor changes.

    Edits of the scene are noticed before the next frame, which is then traced again and takes
    several times as long (not if only the camera or the colours of lights have changed). History
    over shapes that get other primitives is dropped by itself. Frames of several threads take
    turns; a scene must not be edited while it is rendered.

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
        self._keeps_rounds = False
        self._scene: mi.Scene | None = None
        self._shape: tuple[str, int, int] | None = None
        self._plan: Plan
        self._dropped: mi.Bool | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the history: the next frame starts from nothing."""
        with frame_alone():
            self._history: History | None = None
            self._camera: Camera | None = None
            self.frame: Frame | None = None
            self._change: Change | None = None
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
        with frame_alone(), dr.suspend_grad():
            if isinstance(sensor, int):
                sensor = scene.sensors()[sensor]
            check_same_variant(self._variant, scene, sensor)
            spp = checked_spp(spp, sensor)
            self.prepare(scene, sensor)
            self.frame = None
            key = FrameKey(dr.opaque(mi.UInt32, self._sample), checked_seed(seed))
            spectra = spectra_of(sensor, self._sensitivity)
            change, self._change = self._change, None
            settle(sensor, self.aov_names())
            with collection_paused():
                assert self._history is not None
                setting = self._stages.setting(scene, sensor, spectra, key, self._dither)
                sampled = self._stages.sample(setting, self._history, self._camera, spp, change)
                # The old history is released here, so that it does not count at the frame's peak.
                self._history = None
                sampled = self._stages.learn(setting, sampled, self._turn)
                frame = self._stages.share(setting, sampled, self._layouts, self._turn)
            self._history = frame.history
            if self._camera is not None:
                self._camera = copy_camera(sensor)
            self._sample = (self._sample + spp) % WORDS
            self._turn = (self._turn + 1) % WORDS
            self.frame = frame
            image = developed(sensor.film(), frame)
            dr.eval(image)
            return image

    def follow(self, change: Change) -> None:
        """Say what was edited since the last frame, before the next one is rendered.

        With ``retrace_history`` the next frame's history then follows the surfaces, and is weighed
        by the scene that it was made in.
        """
        self._change = change

    def keep_rounds(self) -> None:
        """Begin anew, and have ``frame.rounds`` hold what selection chooses from."""
        with frame_alone():
            self._keeps_rounds = True
            self._shape = None

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
            ``matched``: share of pixels that found their history. ``light``: share of pixels whose
            own candidates carry light, before any reuse. ``not_finite``: how many
            candidates, shifts and merges were not finite; none of them gets into a reservoir, and a
            candidate is shown in its own frame as ``path`` would show it. ``cut``: share of pixels
            with a path that ends at 4,095 edges, the most that can be stored, although longer ones
            were asked for (left out if there is none). One entry per reuse pass
            (``temporal``, ``spatial_0``, ...): the share of shifts by outcome, of those that had
            something to shift. ``mutations``: per class of path, its share of the pixels that had
            their turn, the acceptance rate, the shares of the accepted mutations that raise and
            that lower the target function, and the mean accepted change of direction [rad].
            ``guiding``: the guide as the frame leaves it: the share of its ``cells`` that have seen
            light, and ``alpha``, the mean probability over the pixels with which a path's first
            direction still comes from the BSDF. ``dropped``: share of pixels whose history was
            dropped before the frame, because shapes that it goes over were given other primitives
            (left out if there are no such shapes). ``moving``, where surfaces have moved by an edit
            that :py:meth:`follow` was told of: their ``share`` of the pixels, and of these the
            shares that are ``matched`` and ``not_followed``, because their motion is not rigid.
            ``biased``: parameters that bias the image, if there are any.
        """
        with frame_alone():
            if self.frame is None:
                raise ValueError("restir_pt: there are no statistics before the first frame")
            statistics = frame_statistics(self.frame, self.parameters)
            if self._dropped is not None:
                statistics["dropped"] = float(dr.mean(mi.Float(self._dropped))[0])
            return statistics

    def state(self) -> State:
        """What later frames depend on, where they reuse no earlier ones: see :mod:`.state`."""
        with frame_alone():
            assert self._history is not None
            return State(self._sample, self._turn, self._history.learnt)

    def take_up(self, state: State) -> None:
        """Go on from a state after :meth:`prepare`."""
        with frame_alone():
            assert self._history is not None
            self._sample, self._turn = state.sample, state.turn
            self._history = replace(self._history, learnt=state.learnt)

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

    def prepare(self, scene: mi.Scene, sensor: mi.Sensor) -> None:
        """Check the inputs and start a new history where the old one does not fit."""
        with frame_alone():
            self._dropped = None
            width, height = sensor.film().crop_size()
            shape = (sensor.class_name(), width, height)
            if scene is not self._scene or shape != self._shape:
                self._plan_frames(scene, sensor, shape)
            elif edit := self._watch.look(thorough=self._history is None):
                self._follow(scene, edit)
            if self._history is None:
                self._history = no_history(scene, sensor, self._plan)
                self._camera = copy_camera(sensor) if shape[0] in REPROJECTABLE else None

    def _plan_frames(self, scene: mi.Scene, sensor: mi.Sensor, shape: tuple[str, int, int]) -> None:
        """Check a new scene or sensor and prepare to render its frames."""
        check_scene(scene)
        parameters = self.parameters
        check_sensor(sensor, parameters.temporal)
        self.reset()
        self._scene, self._shape = scene, shape
        self._watch = SceneWatch(scene)
        self._layouts = layouts(parameters.neighbor_sampling, parameters.radii)
        self._dither = dither_of(parameters)
        self._sensitivity = sensitivity()
        self._record_stages(scene)

    def _record_stages(self, scene: mi.Scene) -> None:
        """Plan the frames of a history in the scene as it is."""
        assert self._shape is not None
        self._plan = plan_of(self.parameters, scene, self._shape[1:], self._keeps_rounds)
        self._stages = Stages(self._plan)

    def _follow(self, scene: mi.Scene, edit: Edit) -> None:
        """Let go of what an edit of the scene has made wrong."""
        if edit.replayable:
            return
        if edit.reshaped and fits_compact(scene) != self._plan.form.compact:
            self.reset()
        if self._history is None:
            self._record_stages(scene)
            return
        self._stages.forget()
        if edit.reshaped:
            self._history, self._dropped = without_reshaped(self._history, scene, edit)


# The table of the reference page is written from the declarations.
ReSTIRPTIntegrator.__doc__ = inspect.cleandoc(ReSTIRPTIntegrator.__doc__ or "").replace(
    "{parameters}", page(PARAMETERS.values())
)

mi.register_integrator("restir_pt", ReSTIRPTIntegrator)
