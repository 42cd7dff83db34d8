"""Curves through keyframes: straight, smooth, or smooth without overshooting; held at both ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.spatial.transform import Rotation, Slerp

Array = npt.NDArray[np.float64]
Curve = Callable[[npt.ArrayLike], Array]

INTERPOLATIONS = ("smooth", "linear")
"""What a file may ask for. Smooth points are a natural cubic spline, smooth values (of colours and
other numbers) a monotone one, which stays between its keyframes: a colour must not become negative.
"""


def points(times: Array, values: Array, interpolation: str) -> Curve:
    """The curve through points, (K, D); gives (N, D) for N times, (D,) for one."""
    if len(times) == 1 or interpolation == "linear":
        return _straight(times, values)
    return _held(times, CubicSpline(times, values, bc_type="natural"))


def numbers(times: Array, values: Array, interpolation: str) -> Curve:
    """The curve through values that stays between them, (K, D); gives what :func:`points` does."""
    if len(times) == 1 or interpolation == "linear":
        return _straight(times, values)
    return _held(times, PchipInterpolator(times, values))


def rotations(times: Array, values: Rotation) -> Callable[[float], Rotation]:
    """The shortest turns between rotations, each at constant speed (spherical interpolation)."""
    if len(times) == 1:
        return lambda _: values[0]
    slerp = Slerp(times, values)
    return lambda time: slerp(float(np.clip(time, times[0], times[-1])))


def _straight(times: Array, values: Array) -> Curve:
    def curve(time: npt.ArrayLike) -> Array:
        when = np.asarray(time, dtype=np.float64)
        columns = [np.interp(when, times, column) for column in values.T]
        return np.stack(columns, axis=-1)

    return curve


def _held(times: Array, spline: Any) -> Curve:
    return lambda time: np.asarray(spline(np.clip(time, times[0], times[-1])))
