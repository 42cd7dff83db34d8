"""One file from which a still goes on bit by bit as if it had never stopped."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..arrays import Arrays, load_arrays, save_arrays
from ..errors import UsageError
from ..integrators.flat import flatten, unflatten
from ..integrators.state import packed
from .error import Stated
from .frames import Frames
from .growth import Growth, Snapshot, nothing
from .plan import Plan

_STATE = "state_"
_PLAN = "plan"
_DIGEST = " digest"


@dataclass(frozen=True)
class Checkpoint:
    """
    What is kept of a still.

    Attributes
    ----------
    label : mapping of str to str
        What it belongs to.
    arrays : dict of arrays
    """

    label: Mapping[str, str]
    arrays: Arrays

    @property
    def plan(self) -> Plan:
        """The plan of its frames."""
        values = json.loads(self.label[_PLAN])
        return Plan(self.label["plan name"], values.pop("spp"), values)

    @property
    def why(self) -> str:
        """Why that plan."""
        return self.label["why"]

    @property
    def seconds(self) -> float:
        """Time that the still has taken."""
        return float(self.arrays["seconds"])


def save(path: Path, label: Mapping[str, str], growth: Growth) -> None:
    """
    Write a still that has at least one frame.

    Parameters
    ----------
    label : mapping
        What it belongs to, beside its plan.

    Raises
    ------
    RenderError
        The file cannot be written; what was there before is untouched.
    """
    now = growth.snapshot
    assert now.state is not None
    leaves: list[mi.Float] = []
    flatten((now.sums, now.weights), leaves)
    known = now.known
    plan = growth.source.plan
    planned = {_PLAN: _values(plan), "plan name": plan.name, "why": growth.why}
    save_arrays(
        path,
        {**label, **planned},
        {
            "frames": np.array(now.frames),
            "seconds": np.array(growth.elapsed()),
            "decided": np.array(now.decided),
            "known": np.array([known.error, known.untrimmed, known.not_finite]),
            "sums": np.stack([np.array(leaf) for leaf in leaves]),
            **{f"{_STATE}{name}": array for name, array in packed(now.state).items()},
        },
    )


def load(path: Path, label: Mapping[str, str], plan: Plan | None) -> Checkpoint:
    """
    Read what is kept of a still.

    Parameters
    ----------
    label : mapping
        What it must belong to. What is called a digest is not told.
    plan : Plan or None
        What its frames must have been rendered with; None takes any plan.

    Raises
    ------
    UsageError
        There is none, it is damaged, or it belongs to something else.
    """
    if not path.is_file():
        raise UsageError(f"there is nothing to resume: no file {path}")
    try:
        found, arrays = load_arrays(path)
    except ValueError as error:
        raise UsageError(f"{path} cannot be resumed: {error}") from error
    wanted = {**label, **({} if plan is None else {_PLAN: _values(plan)})}
    for name, value in wanted.items():
        if found.get(name) != value:
            told = (
                "" if _DIGEST in name else f": {found.get(name) or 'none'}, not {value or 'none'}"
            )
            raise UsageError(
                f"{path} cannot be resumed: it is of another {name.removesuffix(_DIGEST)}{told}"
            )
    return Checkpoint(found, arrays)


def _values(plan: Plan) -> str:
    return json.dumps({"spp": plan.spp, **plan.parameters}, sort_keys=True)


def take_up(kept: Checkpoint, source: Frames) -> Snapshot:
    """
    The snapshot that was kept; the source goes on with the frame after it.

    Raises
    ------
    UsageError
        The arrays are not those of such a still.
    """
    arrays, empty = kept.arrays, nothing(source)
    leaves: list[mi.Float] = []
    structure = flatten((empty.sums, empty.weights), leaves)
    state = {
        name.removeprefix(_STATE): array
        for name, array in arrays.items()
        if name.startswith(_STATE)
    }
    try:
        rows = arrays["sums"].reshape(len(leaves), source.size[0] * source.size[1])
        sums, weights = unflatten(structure, (mi.Float(row) for row in rows))
        source.take_up(state)
        error, untrimmed, bad = arrays["known"].tolist()
        return Snapshot(
            int(arrays["frames"]),
            sums,
            weights,
            Stated(error, untrimmed, int(bad)),
            int(arrays["decided"]),
            source.state(),
        )
    except (KeyError, ValueError) as error:
        raise UsageError(f"the checkpoint is not one of such a still: {error}") from error
