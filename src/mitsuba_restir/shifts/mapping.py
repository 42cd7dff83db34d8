"""The choice of shift mapping as data, and the outcomes that a shift can have."""

from __future__ import annotations

from dataclasses import dataclass

from ..sampling.dither import Dither
from .connectability import Criterion

OK = 0
EMPTY = 1  # nothing to shift
TERMINATED = 2  # the replayed prefix ended early
INVERTIBILITY = 3  # the shifted path has an earlier reconnection vertex
UNCONNECTABLE = 4  # the new pair fails the connectability test
DARK = 5  # the shifted integrand vanishes (a BSDF or an emitter faces away)
OCCLUDED = 6  # the new connection is blocked

OUTCOMES = (
    "ok",
    "empty",
    "terminated",
    "invertibility",
    "unconnectable",
    "dark",
    "occluded",
)


@dataclass(frozen=True)
class ShiftMapping:
    """A shift mapping.

    Attributes
    ----------
    criterion : Criterion
        The connectability test.
    last_index : int or None
        Largest index of a reconnection vertex (None: any).
    replays : bool
        Whether a prefix may be replayed. Without it only paths that need none can be shifted.
    dither : Dither or None
        Where the first random numbers of every path come from; None is the hash alone. Candidates
        and replay use the same, or a replay would repeat another path.
    """

    criterion: Criterion
    last_index: int | None
    replays: bool
    dither: Dither | None = None


def shift_mapping(name: str, criterion: Criterion) -> ShiftMapping:
    """The mapping called ``name``: ``hybrid``, ``reconnection`` or ``random_replay``."""
    return {
        "hybrid": ShiftMapping(criterion, None, True),
        "reconnection": ShiftMapping(criterion, 2, False),
        "random_replay": ShiftMapping(criterion, 0, True),
    }[name]
