"""Frames of a moving scene: keyframes, callbacks, and history that follows what moves."""

from .animation import Animation, from_data, load
from .driver import Frame, render
from .shot import WARMUP, Shot

__all__ = ["WARMUP", "Animation", "Frame", "Shot", "from_data", "load", "render"]
