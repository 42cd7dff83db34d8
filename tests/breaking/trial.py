"""One seed: what it renders is checked for values, for stale data, and against ``path``."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import mitsuba as mi
import numpy as np
from support import edits
from support.bias import BiasReport, batch_means, sidak, unbiasedness_test
from support.finite import negative, not_finite, poisoned
from support.modes import Mode
from support.runs import independent_runs

from .generator import Combination, combination, generator

ALPHA = 0.01
"""Probability that a campaign finds a bias where there is none: Sidak's level for each seed.

A seed fails only where a second test, with other random numbers and four times as many, finds it as
well; the rate holds for the first test alone, as far as means of 32 batches are Gaussian."""

BATCHES, BLOCK = 32, 8
REFERENCE_SPP, REFERENCE_BATCHES = 8192, 32
AGAIN = 4
"""How many times the samples of the first test the second one takes."""


@dataclass
class Result:
    """What became of a seed.

    Fields: ``failures`` (kind: what was seen), ``edited`` (keys, in their order), ``refused``
    (values that ``statistics()`` counted as not finite), ``yardstick`` (``path``, or why it is
    none), ``p_values`` (of the tests against it), ``finds`` (the smallest relative error that the
    last of them finds with probability 0.99).
    """

    failures: dict[str, str] = field(default_factory=dict)
    edited: list[str] = field(default_factory=list)
    refused: int = 0
    yardstick: str = "path"
    p_values: list[float] = field(default_factory=list)
    finds: float | None = None


def run(seed: int, seeds: int) -> Result:
    """Render and check what ``seed`` stands for, in a campaign of ``seeds`` seeds."""
    result = Result()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "restir_pt: .* cannot be re-projected")
        chosen = combination(seed)
        scene = mi.load_dict(chosen.scene)
        renderer = mi.load_dict(chosen.parameters)
        _render(renderer, scene, chosen, result)
        rng = generator(seed, 1)
        for step in range(1, chosen.edits + 1):
            result.edited.append(_edit(rng, scene, step))
            _render(renderer, scene, chosen, result)
            _compare_with_new(renderer, scene, chosen, result)
        result.yardstick = yardstick(renderer, scene)
        if result.yardstick == "path" and not result.failures:
            _compare_with_path(renderer, scene, chosen, sidak(ALPHA, seeds), result)
    return result


def _render(renderer: Any, scene: mi.Scene, chosen: Combination, result: Result) -> None:
    """Frames that go on from the last ones, and their values."""
    for t in range(max(chosen.frames, 2)):
        image = renderer.render(scene, seed=t, spp=chosen.spp)
        counts = {
            "pixels not finite": not_finite(image),
            "values of the history not finite": poisoned(renderer),
            "values negative": negative(image, renderer),
        }
        result.refused += renderer.statistics()["not_finite"]
        if any(counts.values()):
            seen = ", ".join(f"{n} {name}" for name, n in counts.items() if n)
            result.failures.setdefault("values", f"{seen}, after edits of {result.edited}")


def _edit(rng: np.random.Generator, scene: mi.Scene, step: int) -> str:
    """Edit one parameter of the scene; its key."""
    parameters = mi.traverse(scene)
    key = str(rng.choice(edits.editable(parameters)))
    value = parameters[key]
    value = value if isinstance(value, int | float) else type(value)(value)
    parameters[key] = edits.edited(key.split(".")[-1], value, step)
    parameters.update()
    return key


def _compare_with_new(renderer: Any, scene: mi.Scene, chosen: Combination, result: Result) -> None:
    """After a reset every bit is that of an integrator that has not seen the scene before."""
    renderer.reset()
    shown = edits.frames(renderer, scene)
    new = edits.untouched(chosen.parameters, scene)
    if not np.array_equal(shown, new, equal_nan=True):
        differ = int((shown != new).any(axis=-1).sum())
        seen = f"{differ} pixels of 2 frames differ, after edits of {result.edited}"
        result.failures.setdefault("stale", seen)


def yardstick(renderer: Any, scene: mi.Scene) -> str:
    """``path``, or why it does not render what is expected of ``restir_pt``."""
    if renderer.parameters.biased:
        return "none: " + ", ".join(renderer.parameters.biased)
    shown = scene.environment() is not None and not renderer.parameters.hide_emitters
    if not shown and any(mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null) for bsdf in _bsdfs(scene)):
        return "none: null lobes and no sky, see the first limitation in README.md"
    return "path"


def _bsdfs(scene: mi.Scene) -> list[mi.BSDF]:
    """Those of all shapes, also of the ones inside groups."""
    nodes = {node for _, _, node, _ in mi.traverse(scene).properties.values()}
    shapes = {*scene.shapes(), *(node for node in nodes if isinstance(node, mi.Shape))}
    return [bsdf for shape in shapes if (bsdf := shape.bsdf()) is not None]


def _compare_with_path(
    renderer: Any, scene: mi.Scene, chosen: Combination, level: float, result: Result
) -> None:
    for stage, more in enumerate((1, AGAIN)):
        report = _bias(renderer, scene, chosen, level, (stage, more))
        result.p_values.append(min(test.p_value for test in report.tests))
        result.finds = report.detectable
        if report.passed:
            return
    result.failures["biased"] = str(report)


def _bias(
    renderer: Any, scene: mi.Scene, chosen: Combination, level: float, effort: tuple[int, int]
) -> BiasReport:
    """Means of independent runs against ``path``; ``effort``: which random numbers, how many."""
    stage, more = effort
    first = 1_000_000 * stage
    path = mi.load_dict(
        {"type": "path"}
        | {key: chosen.parameters[key] for key in ("max_depth", "rr_depth", "hide_emitters")}
    )
    spp = more * REFERENCE_SPP // REFERENCE_BATCHES
    pictures = np.stack(
        [
            np.array(mi.render(scene, integrator=path, spp=spp, seed=first + seed), np.float64)
            for seed in range(REFERENCE_BATCHES)
        ]
    )[..., :3]
    mode = Mode(chosen.parameters, chosen.spp, chosen.frames)
    moves = _camera_at_rest(scene, chosen)
    runs = independent_runs(renderer, scene, mode, moves, first_seed=first)
    count = more * chosen.runs
    return unbiasedness_test(
        batch_means(itertools.islice(runs, count), count // BATCHES),
        pictures.mean(axis=0),
        pictures.var(axis=0, ddof=1) / REFERENCE_BATCHES,
        blocks=(BLOCK, None),
        alpha=level,
        reference_batches=REFERENCE_BATCHES,
        floor=3e-5,
    )


def _camera_at_rest(scene: mi.Scene, chosen: Combination) -> Callable[[int], None] | None:
    """A camera that moves until the last frame of a run; None where it stands still."""
    if not chosen.moving or chosen.frames == 1:
        return None
    parameters = mi.traverse(scene.sensors()[0])
    rest = mi.ScalarTransform4f(np.array(parameters["to_world"].matrix).reshape(4, 4))

    def before_frame(t: int) -> None:
        away = chosen.frames - 1 - t
        offset = mi.ScalarTransform4f().translate([0.03 * away, 0.01 * away, 0.02 * away])
        parameters["to_world"] = mi.Transform4f(offset @ rest)
        parameters.update()

    return before_frame
