"""``mitsuba-restir compare``: one run of the study of that name, as a table and a picture."""

from __future__ import annotations

import argparse
import importlib.resources
import statistics
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from rich.console import Console

from .. import imageio
from ..analysis import metrics
from ..errors import UsageError, rendering
from ..imageio import Image
from ..integrators.declaration import Value
from ..studies import Study, Variant, load_study
from ..studies.config.study import REFERENCE, Size
from ..studies.measure.noise import excess, shares, trimmed
from ..studies.measure.results import Measured
from ..studies.runner import Progress
from ..studies.runs.reference import LEAST_BATCHES, BatchMean
from ..studies.runs.rendering import (
    ENDLESS,
    REFERENCE_KEY,
    Renderer,
    make_integrator,
    renderer_of,
    seed_of,
)
from ..studies.runs.results import ReferenceImage
from ..studies.runs.turns import rehearse, render_run
from . import compare_report, compare_time, loading, output
from .arguments import as_dict, integer, positive_seconds
from .compare_time import Subject
from .notes import say
from .parameters import parse_parameters
from .progress import progress_bar
from .render import add_scene_arguments

SHARED_PARAMETERS = ("max_depth", "rr_depth", "hide_emitters")
"""Parameters that `path` has too."""

REFERENCE_BATCH = 32

Make = Callable[[str, Variant], Renderer]
"""Makes the renderer of a variant that has a name, in the scene that is compared."""


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "compare",
        help="variants side by side, with their errors and times",
        description="Render path tracing and stages of restir_pt side by side; write a table and "
        "a labelled picture.",
    )
    add_scene_arguments(parser)
    parser.add_argument(
        "-o", dest="output", metavar="FOLDER", help="folder for the results (out/compare-SCENE)"
    )
    parser.add_argument(
        "--frames", metavar="N", type=integer(1, 10_000), default=20, help="frames each (20)"
    )
    parser.add_argument(
        "--reference", metavar="EXR", type=Path, help="reference image of the same size"
    )
    parser.add_argument(
        "--reference-spp",
        metavar="N",
        type=integer(LEAST_BATCHES, 2**24),
        default=512,
        help=f"samples per pixel of a reference that is rendered (512; at least {LEAST_BATCHES})",
    )
    parser.add_argument(
        "--make-reference",
        metavar="EXR",
        type=Path,
        help="only render the reference, with path, and write it (16-bit floats)",
    )
    parser.add_argument(
        "--equal-time",
        metavar="S",
        type=positive_seconds,
        help="also show what S seconds each buy: path, a frame of a history and a still, raw and "
        "denoised",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Compare, or make a reference; 0 when all is written."""
    if options.make_reference and options.make_reference.suffix.lower() != ".exr":
        raise UsageError("argument --make-reference: the name must end in .exr")
    loading.choose_variant(options.variant)
    given = imageio.read_rgb(options.reference) if options.reference else None
    size = _size_of(options, None if given is None else given.shape[1::-1])
    # Unlike the scene of a study it may have definitions and several sensors.
    scene = loading.load_scene(options.scene, as_dict(options.definitions, "-D"), size)
    sensor = loading.choose_sensor(scene, options.sensor)
    study = _study(options, size)
    make = _maker(study, scene, sensor)
    renderers = {name: make(name, variant) for name, variant in study.variants.items()}
    folder = Path(options.output or f"out/compare-{Path(options.scene).stem}")
    if options.make_reference:
        output.prepare_folder(options.make_reference.parent, options.make_reference.name)
    else:
        output.prepare_folder(folder)
    spp, origin = options.reference_spp, str(options.reference)
    with rendering(), progress_bar("reference") as progress:
        if options.make_reference:
            _write_reference(study, _render_reference(study, make, spp, progress), options)
            return 0
        if given is None:
            given, origin = _embedded_reference(study, options.sensor), "the committed one"
        if given is None:
            reference = _render_reference(study, make, spp, progress)
            source = f"path, {spp} samples per pixel, whose own error is subtracted"
        else:
            reference = ReferenceImage(given.astype(np.float64), np.zeros(given.shape))
            source = f"{origin}, whose own error is in all errors"
        rows = _rows(study, renderers, reference, progress)
        title = f"{study.scene}, {_size(study)}, depth {_depths(study)['max_depth']}"
        compare_report.write(folder, title, rows, reference.image.astype(np.float32))
        if options.equal_time:
            shown = compare_time.pictures(_subject(study, scene, sensor, options), progress)
            compare_time.write(folder, title, shown, reference)
    console = Console()
    console.print(compare_report.table(title, source, rows))
    means = {row.label: [row.mean] for row in rows}
    data = Measured(_size(study), {}, "", {}, reference, study.epsilon, study.trim)
    if text := excess(shares(data, means, trimmed)):
        say(f"do not rely on relMSE of mean: {text}")
    console.print(f"Pictures and numbers: {folder / compare_report.STRIP} and beside it")
    return 0


def _size_of(options: argparse.Namespace, given: Size | None) -> Size:
    """Return the size asked for, or that of the reference image, or the study's own."""
    size = options.resolution or given or load_study("compare").sizes[0]
    if given not in (None, size):
        raise UsageError(
            f"argument --reference: {options.reference} has {given[0]}x{given[1]} pixels, the "
            f"images have {size[0]}x{size[1]}"
        )
    return size


def _study(options: argparse.Namespace, size: Size) -> Study:
    """Put what the command line says into the study."""
    study = load_study("compare")
    parameters = parse_parameters(as_dict(options.parameters, "-p"))
    shared = {name: value for name, value in parameters.items() if name in SHARED_PARAMETERS}
    own = {"path": shared, "restir_pt": parameters}
    variants = {
        name: replace(variant, parameters={**own[variant.type], **variant.parameters})
        for name, variant in study.variants.items()
    }
    changed = {"scene": options.scene, "frames": options.frames, "seed": options.seed}
    return replace(study, sizes=(size,), variants=variants, **changed)


def _size(study: Study) -> str:
    width, height = study.sizes[0]
    return f"{width}x{height}"


def _subject(study: Study, scene: Any, sensor: Any, options: argparse.Namespace) -> Subject:
    depths = _depths(study)
    reuse = {**depths, **study.variants["spatiotemporal"].parameters}
    return Subject(scene, sensor, depths, reuse, options.equal_time, study.seed)


def _depths(study: Study) -> Mapping[str, Value]:
    """Return the parameters of `path`, which are those of its reference too."""
    return {"max_depth": study.max_depth, **study.variants[study.baseline].parameters}


def _maker(study: Study, scene: Any, sensor: Any) -> Make:
    def make(name: str, variant: Variant) -> Renderer:
        integrator = make_integrator(study, name, variant)
        return renderer_of(scene, sensor, integrator, variant.spp, study.freeze)

    return make


def _rows(
    study: Study,
    renderers: Mapping[str, Renderer],
    reference: ReferenceImage,
    report: Progress,
) -> list[compare_report.Row]:
    """Render one run of all variants, which take turns, and sum up what each has shown."""
    errors: dict[str, list[compare_report.Errors]] = {name: [] for name in renderers}

    def seen(name: str, image: Image | None) -> None:
        assert image is not None
        errors[name].append(_errors(imageio.with_rgb(image, 0), reference))
        done = sum(map(len, errors.values()))
        report(done, len(renderers) * study.frames, "comparing")

    rehearse(study, renderers)
    finished = render_run(study, renderers, 0, seen)
    tail = max(1, study.frames // 4)
    return [
        compare_report.Row(
            name,
            1000.0 * statistics.median(run.times),
            compare_report.Errors(*np.mean(errors[name][-tail:], axis=0).tolist()),
            _errors(mean := imageio.with_rgb(run.mean, 0), reference),
            study.frames,
            imageio.with_rgb(run.last, 0),
            mean,
        )
        for name, run in finished.items()
    ]


def _errors(image: Image, reference: ReferenceImage) -> compare_report.Errors:
    truth, variance = reference.image, reference.variance
    return compare_report.Errors(
        metrics.relmse(image, truth, reference_variance=variance),
        metrics.trimmed_relmse(image, truth, reference_variance=variance),
    )


def _render_reference(study: Study, make: Make, spp: int, report: Progress) -> ReferenceImage:
    """Render with `path` in batches, without Russian roulette, from seeds of its own."""
    most = min(REFERENCE_BATCH, spp // LEAST_BATCHES)
    batches = [most] * (spp // most) + ([spp % most] if spp % most else [])
    parameters = {**_depths(study), **ENDLESS}
    renderers = {n: make(REFERENCE, Variant("path", n, parameters)) for n in set(batches)}
    mean = BatchMean(study.sizes[0])
    for index, samples in enumerate(batches):
        image, _ = renderers[samples].frame(seed_of(study.seed, REFERENCE_KEY, index))
        mean.add(imageio.with_rgb(image, 0), samples)
        report(mean.samples, spp, "reference")
    return mean.image()


def _write_reference(study: Study, reference: ReferenceImage, options: argparse.Namespace) -> None:
    file, spp, depths = options.make_reference, options.reference_spp, _depths(study)
    metadata = {"integrator": f"path {depths}", "spp": str(spp), "scene": study.scene}
    data = imageio.encode_exr(reference.image, metadata=metadata, half=True)
    imageio.write_atomically(file, data)
    print(f"{file}: {spp} samples per pixel by path, {depths}")


def _embedded_reference(study: Study, sensor: int) -> Image | None:
    """Return the reference inside the package, where it is one of exactly this picture."""
    own = load_study("compare")
    same = (study.scene, study.sizes, _depths(study)) == (own.scene, own.sizes, _depths(own))
    if not same or sensor or not mi.variant().endswith("rgb"):
        return None
    resource = importlib.resources.files("mitsuba_restir") / "resources"
    with importlib.resources.as_file(resource / f"{own.scene}_{_size(own)}.exr") as path:
        return imageio.read_rgb(path) if path.is_file() else None
