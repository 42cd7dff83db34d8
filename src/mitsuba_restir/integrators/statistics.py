"""What a frame's reuse did: shares of shifts by outcome, and of mutations by class of path."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from ..guiding.figures import cells_in_use, mean_share_of_bsdf
from ..mutations.chain import Mutated
from ..mutations.pivot import MutationClass
from ..shifts.mapping import MERGE_REFUSED, Outcome
from .frame_data import Found, Frame
from .parameters import Parameters


def frame_statistics(frame: Frame, parameters: Parameters) -> dict[str, Any]:
    """What ``restir_pt``'s ``statistics()`` documents, of a frame."""
    temporal, *rounds = frame.outcomes
    statistics: dict[str, Any] = {
        "matched": float(dr.mean(mi.Float(frame.found.matched))[0]),
        "light": float(dr.mean(mi.Float(frame.beside.lit))[0]),
        "not_finite": int(frame.beside.refused[0]) + refused_count(frame.outcomes),
    }
    if cut := float(dr.mean(mi.Float(frame.beside.cut))[0]):
        statistics["cut"] = cut
    if moving := _moving(frame.found):
        statistics["moving"] = moving
    if temporal:
        statistics["temporal"] = outcome_shares(temporal, 2)
    for index, packed in enumerate(rounds):
        statistics[f"spatial_{index}"] = outcome_shares(packed, 1)
    if frame.mutated is not None:
        statistics["mutations"] = mutation_shares(frame.mutated, parameters.mutations)
    learnt = frame.history.learnt
    if learnt is not None and learnt.guide is not None:
        statistics["guiding"] = {
            "cells": cells_in_use(learnt.guide),
            "alpha": mean_share_of_bsdf(learnt.cells, learnt.guide, frame.history.hits),
        }
    if parameters.biased:
        statistics["biased"] = list(parameters.biased)
    return statistics


def _moving(found: Found) -> dict[str, float]:
    """Shares among the pixels whose surface has moved; empty where none has."""
    moved = int(dr.count(found.moved)[0])
    if not moved:
        return {}
    return {
        "share": moved / dr.width(found.matched),
        "matched": int(dr.count(found.moved & found.matched)[0]) / moved,
        "not_followed": int(dr.count(found.lost)[0]) / moved,
    }


def outcome_shares(packed: list[mi.UInt32], shifts: int) -> dict[str, float]:
    """Share of each outcome among ``shifts`` shifts per lane and array, packed 3 bits each."""
    counts = [
        sum(
            int(dr.count((words >> (3 * i)) & 7 == code)[0])
            for words in packed
            for i in range(shifts)
        )
        for code in range(len(Outcome.names()))
    ]
    tried = max(sum(counts) - counts[Outcome.EMPTY], 1)
    named = zip(Outcome.names(), counts, strict=True)
    return {name: n / tried for name, n in named if name != "empty"}


def refused_count(packed: list[list[mi.UInt32]]) -> int:
    """How many shifts and merges were not finite, by the packed outcomes of all reuse passes."""
    temporal, *rounds = packed
    shifts = [(words, 2) for words in temporal]
    shifts += [(words, 1) for outcomes in rounds for words in outcomes]
    refused = 0
    for words, count in shifts:
        for i in range(count):
            refused += int(dr.count((words >> (3 * i)) & 7 == Outcome.NOT_FINITE)[0])
        refused += int(dr.count((words & MERGE_REFUSED) != 0)[0])
    return refused


def mutation_shares(mutated: Mutated, mutations: int) -> dict[str, dict[str, float]]:
    """Share, acceptance rate, share of steps upwards and mean step of every class of path."""
    names = MutationClass.names()
    kind, accepted = mutated.kind.numpy(), mutated.accepted.numpy()
    raised, lowered = mutated.raised.numpy(), mutated.lowered.numpy()
    angle = mutated.angle.numpy()
    pixels = max(int((kind < len(names)).sum()), 1)
    shares = {}
    for index, name in enumerate(names):
        inside = kind == index
        steps = max(int(accepted[inside].sum()), 1)
        shares[name] = {
            "share": float(inside.sum() / pixels),
            "acceptance": float(accepted[inside].mean() / mutations) if inside.any() else 0.0,
            "raised": float(raised[inside].sum() / steps),
            "lowered": float(lowered[inside].sum() / steps),
            "angle": float(angle[inside].sum() / steps),
        }
    return shares
