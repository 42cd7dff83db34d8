"""What later frames depend on, as plain data that can be kept and taken up again.

Only frames without temporal reuse can be: of what earlier frames left they depend on two running
numbers and on what was learnt, not on paths.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..guiding.policy import Learnt
from .flat import flatten, unflatten

NUMBERS = "numbers"
LEARNT = "learnt_"


@dataclass(frozen=True)
class State:
    """What later frames depend on.

    Attributes
    ----------
    sample : int
        Running number of the next frame's first path tree.
    turn : int
        Running number of the next frame.
    learnt : Learnt or None
        Arrays of the device; later frames leave them as they are. None where nothing is learnt.
    """

    sample: int
    turn: int
    learnt: Learnt | None


def packed(state: State) -> dict[str, npt.NDArray[Any]]:
    """The state as arrays, bit by bit; their names tell them apart."""
    arrays = {NUMBERS: np.array([state.sample, state.turn], dtype=np.uint64)}
    leaves: list[Any] = []
    flatten(state.learnt, leaves)
    for index, leaf in enumerate(leaves):
        if leaf is not None:
            arrays[f"{LEARNT}{index}"] = np.array(leaf)
    return arrays


def unpacked(arrays: Mapping[str, npt.NDArray[Any]], like: Learnt | None) -> State:
    """
    The state that was packed.

    Parameters
    ----------
    arrays : mapping
        As from :func:`packed`.
    like : Learnt or None
        What an integrator with the same parameters has learnt in the same scene at its beginning:
        it tells what is made of the arrays.

    Raises
    ------
    ValueError
        The arrays are not those of such an integrator.
    """
    leaves: list[Any] = []
    structure = flatten(like, leaves)
    expected = {f"{LEARNT}{i}": leaf for i, leaf in enumerate(leaves) if leaf is not None}
    shapes = {NUMBERS: (2,), **{name: np.shape(leaf) for name, leaf in expected.items()}}
    found = {name: array.shape for name, array in arrays.items()}
    if found != shapes:
        raise ValueError(f"restir_pt: a state of arrays {found}, not {shapes}")
    sample, turn = (int(number) for number in arrays[NUMBERS])
    filled = (
        None if leaf is None else type(leaf)(arrays[f"{LEARNT}{i}"])
        for i, leaf in enumerate(leaves)
    )
    learnt = unflatten(structure, filled)
    dr.make_opaque(learnt)
    return State(sample, turn, learnt)
