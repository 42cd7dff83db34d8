"""A camera that looks at a wall, for which frames are made up."""

from __future__ import annotations

import gc
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_restir.passes.primary import camera_rays, primary
from mitsuba_restir.paths.grid import grid_of
from mitsuba_restir.sampling.streams import FrameKey

from . import rooms
from .pixels import lanes_of

WIDTH, HEIGHT = 96, 64


def hits_of(*shapes: dict[str, Any]) -> tuple[Any, mi.Scene]:
    """Primary hits of the wall z = 0 and what is in front of it, and the scene, to be held."""
    gc.collect()  # a scene that vanishes while a frame is recorded breaks the record
    scene = mi.load_dict(
        {
            "type": "scene",
            "wall": {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale([10, 10, 1])},
            **{f"shape_{i}": shape for i, shape in enumerate(shapes)},
            "sensor": {
                "type": "perspective",
                "fov": 50,
                "to_world": rooms.look([0, 0, 4], [0, 0, 0]),
                "film": {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT},
            },
        }
    )
    key = FrameKey(dr.opaque(mi.UInt32, 0), dr.opaque(mi.UInt32, 0))
    rays = camera_rays(scene.sensors()[0], grid_of(WIDTH, HEIGHT), key)
    hits = primary(scene, rays, None, False, False).hit
    dr.make_opaque(hits)
    return hits, scene


def color(values: np.ndarray) -> mi.Color3f:
    """``Color3f`` on the device from an array that broadcasts to (3, HEIGHT, WIDTH)."""
    values = lanes_of(np.broadcast_to(values, (3, HEIGHT, WIDTH)).astype(np.float32))
    # The sum makes arrays of Dr.Jit's own; how NumPy's are aligned differs from call to call.
    result = mi.Color3f([mi.Float(channel.copy()) for channel in values]) + dr.opaque(mi.Float, 0)
    dr.eval(result)
    return result
