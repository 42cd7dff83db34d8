"""Quantities that probes measure: kernels, shifts, rays, memory and the first frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from ...analysis import intervals
from ...analysis.images import FloatArray
from .mutation_spectra import SHARE
from .noise import refusal
from .results import Measured, Refused, Row
from .scalars import lone, make_row


def of_probe(
    probe: str,
    units: Mapping[str, str] | None = None,
    compared: bool = False,
    only: str = "",
) -> Callable[[Measured], Iterator[Row]]:
    """
    Make a quantity of everything that a probe says: mean over runs.

    Parameters
    ----------
    probe : str
        Name of the probe.
    units : mapping of str to str, optional
        Unit by the beginning of a number's name.
    compared : bool
        Give ratios to the baseline too, run by run.
    only : str
        Beginning of the names that are wanted.
    """

    def rows(data: Measured) -> Iterator[Row]:
        for variant in data.variants:
            answers = data.probed(variant, probe)
            names = dict.fromkeys(n for answer in answers for n in answer if n.startswith(only))
            for name in names:
                values = np.array([answer[name] for answer in answers if name in answer])
                value = intervals.mean_interval(values) if values.size > 1 else lone(values[0])
                unit = next((u for start, u in (units or {}).items() if name.startswith(start)), "")
                ratio, p_value = None, None
                if compared and (others := _of_baseline(data, variant, probe, name, values)):
                    p_value = intervals.sign_flip_p_value(values, others)
                    if min(*others, *values) > 0.0:
                        ratio = intervals.ratio_interval(values, others)
                yield make_row(data, variant, name, unit, value, ratio, len(values), p_value)

    return rows


def mutation_spectra(data: Measured) -> Iterator[Row | Refused]:
    """Everything that this probe says, where the reference is sure enough for its powers."""
    probe = "mutation_spectra"
    shares = {
        variant: max((answer.get(SHARE, 0.0) for answer in data.probed(variant, probe)), default=0)
        for variant in data.variants
    }
    if refused := refusal(data.size, "spectra of mutations", shares):
        yield refused
        return
    yield from of_probe(probe, compared=True)(data)


def _of_baseline(
    data: Measured, variant: str, probe: str, name: str, values: FloatArray
) -> list[float]:
    """Return a number of the baseline's same runs; empty where there are none to compare."""
    baseline = data.baselines.get(variant, data.baseline)
    others = [answer[name] for answer in data.probed(baseline, probe) if name in answer]
    return others if baseline != variant and len(others) == len(values) > 1 else []


def memory_slopes(sizes: Sequence[Measured]) -> Iterator[Row]:
    """
    Peak bytes per pixel: slope of a straight line through the sizes, run by run.

    The slope leaves out what does not grow with the image, such as scene and kernels. Dr.Jit rounds
    every array to a power of two, so that sizes which are none measure the rounding as well.
    """
    pixels = np.array([data.pixels for data in sizes], dtype=np.float64)
    if len(sizes) < 2:
        return
    first = sizes[0]
    for variant in first.variants:
        answers = [data.probed(variant, "memory") for data in sizes]
        runs = min(len(answer) for answer in answers)
        for name, label in (
            ("peak", "slope of the peak, Dr.Jit's memory"),
            ("peak resident", "slope of the peak, resident memory"),
        ):
            if runs == 0 or any(name not in a for answer in answers for a in answer):
                continue
            peaks = np.array([[answer[run][name] for answer in answers] for run in range(runs)])
            slopes = np.polyfit(pixels, peaks.T, 1)[0]
            value = intervals.mean_interval(slopes) if runs > 1 else lone(float(slopes[0]))
            yield Row("all", variant, label, "B/pixel", value, None, runs)
