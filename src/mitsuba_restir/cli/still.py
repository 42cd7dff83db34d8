"""``mitsuba-restir still``: one picture, to a stated error."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import mitsuba as mi

from .. import __version__, scene_files
from ..errors import UsageError, rendering
from ..integrators.declaration import Value
from ..integrators.images import asking_for
from ..passes.shade import AOVS
from ..still import checkpoint
from ..still.driver import begun
from ..still.frames import PREVIEWS, Frames, Subject, check_parameters, previewed
from ..still.goal import ERROR, LEAST, Goal, goal_of
from ..still.growth import Growth
from ..still.picture import stopwatch
from ..still.plan import PLANS, Plan, parse
from . import denoising, loading, output, tev
from .arguments import as_dict, integer, place, positive, positive_seconds, seconds_between
from .notes import say
from .parameters import parse_aovs, parse_parameters
from .progress import still_bar
from .render import MAX_FRAMES, add_aovs_argument, add_scene_arguments
from .signals import held
from .still_files import SUFFIX, StillFiles
from .writer import DENOISED

EVERY = 60.0
"""Seconds between checkpoints."""

SHOWN_EVERY = 1.0
"""Seconds between pictures that tev is sent."""

NOTHING_TO_CHOOSE = "has no spatial reuse, so that blue_noise=selection has nothing to choose from"


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "still",
        help="render one picture to a stated error",
        description="Render one picture, the mean of independent frames of restir_pt, until its "
        f"stated error is as small as asked for ({ERROR:g} where nothing is). The plan of the "
        "frames is found by a short pilot, or given.",
    )
    add_scene_arguments(parser)
    parser.add_argument(
        "-o",
        dest="output",
        metavar="OUT",
        help="a name (EXR and PNG), a name ending in .png (PNG only), or a folder; existing files "
        "are replaced",
    )
    until = parser.add_mutually_exclusive_group()
    until.add_argument(
        "--error",
        metavar="E",
        type=positive,
        help="stop at this relative error: the root of the mean over pixels of the variance of "
        "the mean over its square as its surroundings have it, without the worst 0.1 %% of them",
    )
    until.add_argument(
        "--time-budget",
        metavar="S",
        type=positive_seconds,
        help="stop after S seconds, the choice of the plan included",
    )
    until.add_argument(
        "--frames", metavar="N", type=integer(LEAST, MAX_FRAMES), help="stop after N frames"
    )
    parser.add_argument(
        "--plan",
        metavar="PLAN",
        help=f"what frames are rendered with: {', '.join(PLANS)}, or values as in "
        "spp=8,spatial_rounds=5 (what a pilot finds)",
    )
    parser.add_argument(
        "--max-depth", metavar="N", type=integer(-1), help="longest path depth (-1: no limit)"
    )
    parser.add_argument(
        "--denoise",
        action="store_true",
        help="also write the picture denoised (OIDN), and plan for that",
    )
    add_aovs_argument(parser)
    parser.add_argument(
        "--checkpoint-every",
        metavar="S",
        type=seconds_between,
        default=EVERY,
        help=f"keep what is needed to go on in OUT{SUFFIX}, every S seconds ({EVERY:g}), when "
        "interrupted and at the end; 0 never does",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on from the checkpoint, with the error, time or frames that are asked for now",
    )
    parser.add_argument(
        "--tev",
        metavar="HOST:PORT",
        type=partial(place, port=tev.PORT),
        help=f"show the growing picture in a running tev (port {tev.PORT}); with -p "
        "blue_noise=selection steered so that its error is blue, until it ends",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Render; 0 when the picture is written."""
    goal = goal_of(options.error, options.time_budget, options.frames)
    parameters, seen = _parameters(options)
    aovs = parse_aovs(options.aovs) if options.aovs is not None else {}
    if options.denoise:
        denoising.require()
    plan = None if options.plan is None else _plan(options.plan)
    target = output.plan(options.output, options.scene, numbered=False)
    subject = _subject(options, parameters, aovs, seen)
    if plan is not None and seen is not None and not subject.planned(plan).mixes:
        raise UsageError(f"argument --plan: '{options.plan}' {NOTHING_TO_CHOOSE}")
    output.prepare_folder(target.stem.parent, f"{target.name(0, DENOISED).name}{SUFFIX}")
    files = StillFiles(
        target,
        _label(options, subject),
        options.checkpoint_every,
        [f"{name}.{suffix}" for name, kind in aovs.items() for suffix in AOVS[kind].channels],
        {"scene": options.scene, "variant": mi.variant(), "seed": str(options.seed)},
    )
    elapsed = stopwatch()
    with tev.Tev(options.tev, target.name(0).name) as viewer:
        if not viewer.connected:
            # Previews take time and memory, and nobody sees them.
            subject = replace(subject, previewed=None)
        with rendering():
            if options.resume:
                growth = _resumed(subject, plan, files, elapsed)
            else:
                growth = begun(subject, plan, goal, elapsed)
        print(f"{growth.source.plan.describe()} ({growth.why})")
        if subject.previewed is not None and not growth.source.plan.mixes:
            say(f"the plan {NOTHING_TO_CHOOSE}; the plain mean is shown")
        _grow(growth, goal, files, options, viewer)
    return 0


def _plan(text: str) -> Plan:
    try:
        return parse(text)
    except ValueError as error:
        raise UsageError(f"argument --plan: {error}") from error


def _parameters(options: argparse.Namespace) -> tuple[dict[str, Value], float | None]:
    """What a still is rendered with, and how previews of it are seen."""
    given = as_dict(options.parameters, "-p")
    try:
        check_parameters({name: text for name, text in given.items() if name == "preset"})
        parameters = parse_parameters(given)
        asked = {name: parameters.pop(name) for name in PREVIEWS if name in parameters}
        check_parameters(parameters)
        seen = _seen_through(asked, options)
    except ValueError as error:
        raise UsageError(f"argument -p: {error}") from error
    if options.max_depth is not None:
        if "max_depth" in parameters:
            raise UsageError("argument --max-depth: not allowed with -p max_depth")
        parameters["max_depth"] = options.max_depth
    return parameters, seen


def _seen_through(asked: Mapping[str, Value], options: argparse.Namespace) -> float | None:
    """What is asked of previews."""
    found = previewed(asked)
    if found is None and (unused := [name for name in asked if name != "blue_noise"]):
        raise UsageError(
            f"argument -p: {unused[0]} says how previews are seen, and needs blue_noise=selection"
        )
    if found is not None and options.tev is None:
        raise UsageError(
            "argument -p: blue_noise=selection steers what is shown of a still while it grows, not "
            "what is written, and needs --tev"
        )
    return found


def _subject(
    options: argparse.Namespace,
    parameters: Mapping[str, Value],
    aovs: Mapping[str, str],
    seen: float | None,
) -> Subject:
    """Load what is to be rendered, and refuse what the plugin would refuse later."""
    loading.choose_variant(options.variant)
    images = {"aovs": asking_for(aovs)} if aovs else {}
    loading.make_integrator("restir_pt", {**parameters, **images})
    definitions = as_dict(options.definitions, "-D")
    scene = loading.load_scene(options.scene, definitions, options.resolution)
    sensor = loading.choose_sensor(scene, options.sensor)
    return Subject(scene, sensor, options.seed, parameters, aovs, options.denoise, seen)


def _label(options: argparse.Namespace, subject: Subject) -> dict[str, str]:
    """What a checkpoint belongs to, in the words of the command."""

    def listed(values: Mapping[str, Any]) -> str:
        return " ".join(f"{name}={value}" for name, value in sorted(values.items()))

    width, height = subject.sensor.film().crop_size()
    aovs = {**subject.aovs, **({"denoise": "true"} if subject.guides else {})}
    return {
        "mitsuba-restir": __version__,
        "variant": str(mi.variant()),
        "scene digest": scene_files.digest(options.scene),
        "set of definitions": listed(as_dict(options.definitions, "-D")),
        "sensor": str(options.sensor),
        "size": f"{width}x{height}",
        "seed": str(options.seed),
        "set of parameters": listed(subject.parameters),
        "set of auxiliary images": listed(aovs),
    }


def _resumed(
    subject: Subject, plan: Plan | None, files: StillFiles, elapsed: Callable[[], float]
) -> Growth:
    asked = None if plan is None else subject.planned(plan)
    kept = checkpoint.load(files.checkpoint, files.label, asked)
    source = Frames(subject, kept.plan)
    snapshot = checkpoint.take_up(kept, source)
    files.kept = snapshot.frames
    return Growth(source, kept.why, lambda: kept.seconds + elapsed(), snapshot)


def _grow(
    growth: Growth,
    goal: Goal,
    files: StillFiles,
    options: argparse.Namespace,
    viewer: tev.Tev,
) -> None:
    """Render to the goal; whatever comes, what there is gets written, and shown as it is."""
    try:
        with rendering():
            try:
                _watched(growth, goal, files, viewer)
            finally:
                if growth.has_picture:
                    viewer.show(growth.picture())
    except KeyboardInterrupt as error:
        hint = f"--resume goes on from {files.checkpoint}" if options.checkpoint_every else ""
        raise KeyboardInterrupt(hint if growth.snapshot.frames else "") from error
    finally:
        with held():
            _finish(growth, files, options)


def _watched(growth: Growth, goal: Goal, files: StillFiles, viewer: tev.Tev) -> None:
    """Render to the goal, and show what there is, as long as somebody sees it."""
    shown = 0.0
    with still_bar() as report:
        for now in growth.grow(goal):
            report(now)
            files.tick(growth)
            if viewer.connected and time.perf_counter() - shown >= SHOWN_EVERY:
                viewer.show(growth.shown())
                shown = time.perf_counter()
            growth.steer(viewer.connected)


def _finish(growth: Growth, files: StillFiles, options: argparse.Namespace) -> None:
    if not growth.has_picture:
        return
    try:
        still = growth.still(options.denoise)
        files.write(still)
    finally:
        files.keep(growth)
    if still.remark:
        print(still.remark)
    names = ", ".join(map(str, files.written))
    print(
        f"{still.frames} frames in {still.seconds:.1f} s, error {still.error:.3g} "
        f"({still.untrimmed:.3g} with all pixels): {names}"
    )
