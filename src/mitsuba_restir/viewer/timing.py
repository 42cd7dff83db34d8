"""Where a frame's time goes: the kernels that were launched, by the pass that they belong to."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence

from ..integrators.declaration import Value

Kernel = tuple[int, float]
"""How many lanes a kernel had, and its time [ms]."""


def by_pass(
    kernels: Sequence[Kernel], pixels: int, values: Mapping[str, Value], table: int
) -> dict[str, float]:
    """
    Milliseconds of each pass of one frame.

    Passes end with an evaluation each (`integrators/frame.py`), so that their kernels come one
    after the other. Those of another size than the picture belong to the pass before them.

    Parameters
    ----------
    kernels : sequence of (int, float)
    pixels : int
    values : mapping
        Of all parameters.
    table : int
        Entries of the guide's tables: only learning has kernels of multiples of it.

    Returns
    -------
    dict
        In the order of the frame. Spatial reuse has selection and shading in it. Where the kernels
        are not those of a recorded frame, all are ``frame``.
    """
    sized = [index for index, (lanes, _) in enumerate(kernels) if lanes == pixels]
    temporal = (1 + int(bool(values["retrace_history"]))) if values["temporal"] else 0
    if len(sized) < 4 + temporal:
        return {"frame": sum(time for _, time in kernels)}
    starts = [(0, "camera rays"), (sized[1], "candidates")]
    if temporal:
        starts.append((sized[2], "temporal reuse"))
    rest = sized[2 + temporal]
    if values["guiding"] or values["roulette"] == "contribution":
        inside = range(rest, sized[-1])
        tables = [i for i in inside if kernels[i][0] % table == 0 and kernels[i][0] != pixels]
        if tables:
            starts.append((rest, "learning"))
            rest = next(index for index in sized if index > tables[-1])
    if values["mutations"]:
        starts.append((rest, "mutations"))
        rest = sized[sized.index(rest) + 1]
    starts += [(rest, "spatial reuse" if values["spatial"] else "shading"), (sized[-1], "film")]
    spent = {name: 0.0 for _, name in starts}
    first = [index for index, _ in starts]
    for index, (_, time) in enumerate(kernels):
        spent[starts[bisect_right(first, index) - 1][1]] += time
    return spent
