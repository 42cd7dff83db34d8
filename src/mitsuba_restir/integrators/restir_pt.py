"""The ``restir_pt`` plugin: ReSTIR path tracing as a Mitsuba integrator."""

from __future__ import annotations

import warnings
from typing import Any

import drjit as dr
import mitsuba as mi

from ..passes.shade import AOV_CHANNELS
from ..paths.camera import REPROJECTABLE, Camera, copy_camera
from ..paths.settings import PathLimits
from ..shifts.connectability import Criterion, DistanceRoughness, Footprint
from ..shifts.mapping import shift_mapping
from .frame import Frame, History, Plan, no_history, render_frame
from .parameters import read_parameters


class ReSTIRPTIntegrator(mi.CppADIntegrator):
    r"""
    .. _integrator-restir_pt:
    """

    def __init__(self, props: mi.Properties) -> None:
        super().__init__(props)
        self.parameters = read_parameters(props)
        self.reset()

    def reset(self) -> None:
        """Forget the history: the next frame starts from nothing."""
        self._history: History | None = None
        self._camera: Camera | None = None
        self._plan: Plan | None = None
        self._key: tuple[Any, ...] = ()
        self._sample = 0

    def render(
        self,
        scene: mi.Scene,
        sensor: int | mi.Sensor = 0,
        seed: int = 0,
        spp: int = 0,
        develop: bool = True,
        evaluate: bool = True,
    ) -> mi.TensorXf:
        if isinstance(sensor, int):
            sensor = scene.sensors()[sensor]
        film = sensor.film()
        spp = spp or sensor.sampler().sample_count()
        with dr.suspend_grad():
            self._prepare(scene, sensor)
            assert self._plan is not None and self._history is not None
            frame = render_frame(
                self._plan,
                scene,
                sensor,
                self._history,
                self._camera,
                dr.opaque(mi.UInt32, self._sample),
                dr.opaque(mi.UInt32, seed),
                dr.opaque(mi.UInt32, spp),
            )
            self._history = frame.history
            if self._plan.follows:
                self._camera = copy_camera(sensor)
            self._sample += spp
            self._frame = frame
            return self._develop(film, frame)

    def aov_names(self) -> list[str]:
        return [
            f"{name}.{suffix}"
            for name, kind in self.parameters.aovs
            for suffix in AOV_CHANNELS[kind]
        ]

    def _prepare(self, scene: mi.Scene, sensor: mi.Sensor) -> None:
        film = sensor.film()
        width, height = film.crop_size()
        key = (id(scene), sensor.class_name(), width, height)
        if self._plan is not None and key == self._key:
            return
        self.reset()
        self._key = key
        parameters = self.parameters
        follows = sensor.class_name() in REPROJECTABLE
        self._plan = Plan(
            parameters,
            PathLimits(parameters.max_depth, parameters.rr_depth),
            shift_mapping(parameters.shift, _criterion(parameters.connectability, scene)),
            width,
            height,
            follows,
            self.skip_area_emitters if parameters.hide_emitters else None,
        )
        self._history = no_history(width * height)
        if follows:
            self._camera = copy_camera(sensor)

    def _develop(self, film: mi.Film, frame: Frame) -> mi.TensorXf:
        film.prepare(self.aov_names())
        block = film.create_block()
        block.set_coalesce(False)
        width = self._plan.width
        index = dr.arange(mi.UInt32, width * self._plan.height)
        y = index // width
        position = mi.Point2f(mi.Point2u(index - y * width, y)) + 0.5 + mi.Point2f(film.crop_offset())
        color = frame.color
        alpha = [frame.alpha] if mi.has_flag(film.flags(), mi.FilmFlags.Alpha) else []
        block.put(position, [*color, *alpha, mi.Float(1), *frame.auxiliary])
        film.put_block(block)
        return film.develop()


def _criterion(name: str, scene: mi.Scene) -> Criterion:
    if name == "footprint":
        return Footprint()
    radius = float(dr.norm(scene.bbox().extents())) / 2
    return DistanceRoughness(0.03 * radius)


mi.register_integrator("restir_pt", lambda props: ReSTIRPTIntegrator(props))
