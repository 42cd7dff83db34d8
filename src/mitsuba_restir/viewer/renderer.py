"""Frames of any side, size and camera: one sensor, and an integrator for each side and size.

An integrator keeps its history and its recordings as long as it is kept, so that what is switched
on and off again goes on where it was. All of it belongs to the worker's thread.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from ..errors import one_line
from ..guiding.cells import CELLS
from ..imageio import Image, with_rgb
from ..integrators.frame_data import Frame
from ..integrators.recording import frame_alone
from ..passes.shade import AOVS, Shown
from ..paths.grid import grid_of
from . import timing
from .camera import Pose, matrix_of, pose_of
from .model import Side, effective

Size = tuple[int, int]

KEPT = 4
"""Pictures in full size whose worth of pixels integrators may keep histories of."""

RECORDED = 2
"""Frames in which an integrator records: the first has no history."""


@dataclass(frozen=True)
class Shot:
    """
    One frame of one side.

    Attributes
    ----------
    side : Side
    pose : Pose or None
        Where the camera was.
    image : array, (H, W, 3)
        Linear colour.
    frame : Frame
        What it was made of, on the device.
    seconds : float
        It took.
    passes : mapping of str to float
        Milliseconds by pass; empty where they were not wanted.
    compiled : int
        Kernels that had to be compiled.
    warm : bool
        Whether all was recorded before, so that the next one takes as long.
    before : Pose or None
        Where the camera was in the frame before.
    """

    side: Side
    pose: Pose | None
    image: Image
    frame: Frame
    seconds: float
    passes: Mapping[str, float]
    compiled: int
    warm: bool
    before: Pose | None = None

    @property
    def size(self) -> Size:
        """Width and height [pixels]."""
        return self.image.shape[1], self.image.shape[0]

    def auxiliary(self, kind: str) -> npt.NDArray[np.float32]:
        """An auxiliary image, (H, W, C), from what the frame has left: no other frame is needed."""
        history = self.frame.history
        black = mi.Color3f(0)
        shown = Shown(history.hits, mi.Vector2f(0), history.reservoirs, black, black, black)
        with frame_alone():
            return self.channels([mi.Float(channel) for channel in AOVS[kind].shown(shown)])

    def channels(self, values: list[mi.Float]) -> npt.NDArray[np.float32]:
        """Values of every pixel as an image, (H, W, C)."""
        grid = grid_of(*self.size)
        # A value that is the same everywhere has one entry only.
        whole = [np.broadcast_to(np.array(value), grid.size) for value in values]
        return np.moveaxis(grid.image(np.stack(whole)), 0, -1)


class Renderer:
    """
    Renders a scene.

    Parameters
    ----------
    scene : Scene
    sensor : Sensor
        Of the scene. It is moved and resized in place.
    seed : int
    announce : callable
        Is told, in a word or two, what takes longer than a frame.

    Attributes
    ----------
    full : (int, int)
        Width and height of the film as it was given [pixels].
    home : Pose or None
        Where the camera was; None where the sensor cannot be moved.
    radius : float
        Of the scene.
    """

    def __init__(
        self, scene: mi.Scene, sensor: mi.Sensor, seed: int, announce: Callable[[str], None]
    ) -> None:
        self.scene, self.sensor, self.seed = scene, sensor, seed
        self._announce = announce
        self._state = mi.traverse(sensor)
        self._film = {name: self._read(f"film.{name}") for name in ("size", "crop_size")}
        self._film["crop_offset"] = self._read("film.crop_offset")
        width, height = self._film["crop_size"]
        self.full: Size = (int(width), int(height))
        self.radius = max(0.5 * float(dr.norm(scene.bbox().extents())), 1e-6)
        self._matrix = None
        if "to_world" in self._state:
            matrix = self._state["to_world"].matrix
            self._matrix = np.array(matrix, dtype=np.float64).reshape(4, 4)
        self.home = self._home()
        self._placed: tuple[Size, Pose | None] = (self.full, self.home)
        self._integrators: dict[tuple[Any, ...], Any] = {}
        self._frames: Counter[Any] = Counter()

    def shoot(self, side: Side, pose: Pose | None, size: Size, timed: bool) -> Shot:
        """
        The next frame of a side.

        Parameters
        ----------
        timed : bool
            Whether its time by pass is wanted: to fetch the list of kernels takes a millisecond or
            two. The first frame always has it.

        Raises
        ------
        ValueError
            The integrator refuses its parameters, or the scene.
        """
        self.place(pose, size)
        timed = timed or not self.knows(side, size)
        integrator = self._integrator(side, size)
        # Always on: frames are recorded anew when a flag changes.
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            begin = time.perf_counter()
            film = integrator.render(self.scene, self.sensor, seed=self.seed, spp=side.spp)
            image = with_rgb(film, 0)
            seconds = time.perf_counter() - begin
            history = dr.kernel_history([dr.KernelType.JIT]) if timed else []
        kernels = [(int(k["size"]), float(k["execution_time"])) for k in history]
        values = effective(side.parameters)
        passes = timing.by_pass(kernels, size[0] * size[1], values, CELLS) if timed else {}
        compiled = sum(not k["cache_hit"] for k in history)
        self._frames[integrator] += 1
        warm = self._frames[integrator] > RECORDED
        return Shot(side, pose, image, integrator.frame, seconds, passes, compiled, warm)

    def place(self, pose: Pose | None, size: Size) -> None:
        """Move the sensor, and give its film a size; a crop window keeps its place."""
        size_now, pose_now = self._placed
        if (size, pose) == (size_now, pose_now):
            return
        if size != size_now:
            share = np.array(size) / np.array(self.full)
            for name, value in self._film.items():
                whole = np.round(value * share).astype(int)
                self._state[f"film.{name}"] = [int(side) for side in whole]
            self._state["film.crop_size"] = list(size)
        if pose is not None and pose != pose_now:
            matrix = self._matrix if pose == self.home else matrix_of(pose)
            self._state["to_world"] = mi.ScalarTransform4f(matrix)
        self._state.update()
        self._placed = (size, pose)

    def knows(self, side: Side, size: Size) -> bool:
        """Whether its frames are recorded."""
        return (side.rendered, size) in self._integrators

    def reset(self) -> None:
        """Forget all histories."""
        for integrator in self._integrators.values():
            integrator.reset()

    def _integrator(self, side: Side, size: Size) -> Any:
        key = (side.rendered, size)
        integrator = self._integrators.pop(key, None)
        if integrator is None:
            self._announce("compiling")
            try:
                integrator = mi.load_dict({"type": "restir_pt", **side.parameters})
            except (RuntimeError, ValueError, TypeError) as error:
                raise ValueError(one_line(error)) from error
            self._make_room(size)
        self._integrators[key] = integrator
        return integrator

    def _make_room(self, size: Size) -> None:
        """Drop the integrators that were used longest ago."""
        room = KEPT * self.full[0] * self.full[1] - size[0] * size[1]
        while self._integrators and sum(w * h for _, (w, h) in self._integrators) > room:
            oldest = self._integrators.pop(next(iter(self._integrators)))
            del self._frames[oldest]

    def _home(self) -> Pose | None:
        """Where the sensor is; its orbit goes around what is in the middle of the picture."""
        if self._matrix is None:
            return None
        origin, forward = self._matrix[:3, 3], self._matrix[:3, 2]
        forward = forward / np.linalg.norm(forward)
        ray = mi.Ray3f(mi.Point3f(*origin.tolist()), mi.Vector3f(*forward.tolist()))
        distance = float(self.scene.ray_intersect_preliminary(ray).t[0])
        if not 0 < distance < 4 * self.radius:
            distance = self.radius
        fov = float(self._read("x_fov")[0]) if "x_fov" in self._state else None
        return pose_of(self._matrix, distance, fov)

    def _read(self, name: str) -> npt.NDArray[np.float64]:
        return np.ravel(np.array(self._state[name], dtype=np.float64))
