"""Frames of a moving scene: keyframes, callbacks, and history that follows what moves."""

from .animation import Animation, from_data, load
from .driver import WARMUP, Frame, render

__all__ = ["WARMUP", "Animation", "Frame", "from_data", "load", "render"]
