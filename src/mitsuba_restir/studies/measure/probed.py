"""Quantities that probes measure: what `restir_pt` says of its frames, and what mutations do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...analysis import intervals
from ...analysis.images import FloatArray
from .mutation_spectra import SHARE
from .results import Measured, Number, Refused, Row, Rows
from .rows import interval_of, make_row, ratio_of, unless_noisy


def of_probe(probe: str, compared: bool = False) -> Rows:
    """
    Make a quantity of what a probe says: mean over runs.

    Its numbers are those that are declared; everything that the probe says, where none are.

    Parameters
    ----------
    probe : str
        Name of the probe.
    compared : bool
        Give ratios to the baseline too, run by run.
    """

    def rows(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
        for variant in data.variants:
            baseline = data.baselines.get(variant, data.baseline)
            answers = data.probed(variant, probe)
            names = dict.fromkeys(name for answer in answers for name in answer)
            for number in numbers or map(Number, names):
                values = _values(data, variant, probe, number.name)
                if not values.size:
                    continue
                ratio, p_value = None, None
                others = _values(data, baseline, probe, number.name)
                if compared and baseline != variant and others.size == values.size > 1:
                    p_value = intervals.sign_flip_p_value(values, others)
                    if min(*others, *values) > 0.0:
                        ratio = ratio_of(values, others)
                row = make_row(data, variant, number, interval_of(values), ratio, p_value)
                yield replace(row, runs=values.size)

    return rows


def _values(data: Measured, variant: str, probe: str, name: str) -> FloatArray:
    """Return a number of every run that has it, (K,)."""
    answers = data.probed(variant, probe)
    return np.array([answer[name] for answer in answers if name in answer])


def mutation_spectra(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
    """Everything that this probe says, where the reference is sure enough for its powers."""
    probe = "mutation_spectra"
    shares = {
        variant: max((answer.get(SHARE, 0.0) for answer in data.probed(variant, probe)), default=0)
        for variant in data.variants
    }
    rows = of_probe(probe, compared=True)(data, numbers)
    yield from unless_noisy(data, "spectra of mutations", shares, rows)
