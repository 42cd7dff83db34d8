"""``mitsuba-restir compare``: one run of the study of that name, as a table and a picture."""

from __future__ import annotations

import argparse
import importlib.resources
import statistics
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from rich.console import Console

from .. import imageio
from ..analysis import metrics
from ..errors import UsageError, rendering
from ..imageio import Image
from ..studies import Study, Variant, load_study
from ..studies.config.study import REFERENCE
from ..studies.measure.noise import excess, shares, trimmed
from ..studies.measure.results import Measured
from ..studies.runner import Progress
from ..studies.runs.batches import LEAST_BATCHES, BatchMean
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
from . import compare_report, loading, output
from .arguments import as_dict, integer
from .parameters import Value, parse_parameters
from .progress import progress_bar
from .render import add_scene_arguments

SHARED_PARAMETERS = ("max_depth", "rr_depth", "hide_emitters")
"""Parameters that `path` has too."""

REFERENCE_BATCH = 32


@dataclass(frozen=True)
class View:
    """
    What is compared, as the command line says it.

    Fields
    ------
    study : Study
        The packaged study with the scene's name, size, frames, seed and parameters put in.
    scene, sensor
        As loaded.
    shared : mapping
        The parameters that `path` has too.
    """

    study: Study
    scene: Any
    sensor: Any
    shared: Mapping[str, Value]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.study.sizes[0]


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
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Compare, or make a reference; 0 when all is written."""
    if options.make_reference and options.make_reference.suffix.lower() != ".exr":
        raise UsageError("argument --make-reference: the name must end in .exr")
    loading.choose_variant(options.variant)
    given = imageio.read_rgb(options.reference) if options.reference else None
    view = _view(options, None if given is None else given.shape[1::-1])
    folder = Path(options.output or f"out/compare-{Path(options.scene).stem}")
    output.prepare_folder(options.make_reference.parent if options.make_reference else folder)
    if options.make_reference:
        return _make_reference(view, options)
    origin = str(options.reference)
    if given is None:
        given, origin = _embedded_reference(view, options), "the committed one"
    source = f"{origin}, whose own error is in all errors"
    with rendering(), progress_bar("reference") as progress:
        if given is None:
            spp = options.reference_spp
            reference = _render_reference(view, spp, progress)
            source = f"path, {spp} samples per pixel, whose own error is subtracted"
        else:
            reference = ReferenceImage(given.astype(np.float64), np.zeros(given.shape))
        rows = _rows(view, reference, progress)
    _show(view, folder, source, rows, reference)
    return 0


def _view(options: argparse.Namespace, given: tuple[int, int] | None) -> View:
    """Put scene and parameters into the study; `given` is the size of the reference image."""
    study = load_study("compare")
    size = options.resolution or given or study.sizes[0]
    parameters = parse_parameters(as_dict(options.parameters, "-p"))
    shared = {name: value for name, value in parameters.items() if name in SHARED_PARAMETERS}
    variants = {
        name: replace(
            v, parameters={**(shared if v.type == "path" else parameters), **v.parameters}
        )
        for name, v in study.variants.items()
    }
    scene = loading.load_scene(options.scene, as_dict(options.definitions, "-D"), size)
    sensor = loading.choose_sensor(scene, options.sensor)
    if given not in (None, size):
        raise UsageError(
            f"argument --reference: {options.reference} has {given[0]}x{given[1]} "
            f"pixels, the images have {size[0]}x{size[1]}"
        )
    changed = replace(
        study,
        scene=options.scene,
        sizes=(size,),
        variants=variants,
        frames=options.frames,
        seed=options.seed,
    )
    return View(changed, scene, sensor, shared)


def _renderer(view: View, name: str, variant: Variant) -> Renderer:
    integrator = make_integrator(view.study, name, variant)
    return renderer_of(view.scene, view.sensor, integrator, variant.spp, view.study.freeze)


def _rows(view: View, reference: ReferenceImage, report: Progress) -> list[compare_report.Row]:
    """Render one run of all variants, which take turns, and sum up what each has shown."""
    study = view.study
    renderers = {name: _renderer(view, name, v) for name, v in study.variants.items()}
    errors: dict[str, list[compare_report.Errors]] = {name: [] for name in renderers}

    def seen(name: str, image: Image | None) -> None:
        if image is not None:
            errors[name].append(_errors(imageio.with_rgb(image, 0), reference))
        done = sum(map(len, errors.values()))
        report(done, len(renderers) * study.frames, "comparing")

    rehearse(study, renderers)
    finished = render_run(study, renderers, 0, seen)
    return [
        compare_report.Row(
            name,
            1000.0 * statistics.median(finished[name].times),
            compare_report.mean(own[-max(1, study.frames // 4) :]),
            _errors(mean := imageio.with_rgb(finished[name].mean, 0), reference),
            study.frames,
            imageio.with_rgb(finished[name].last, 0),
            mean,
        )
        for name, own in errors.items()
    ]


def _errors(image: Image, reference: ReferenceImage) -> compare_report.Errors:
    truth, variance = reference.image, reference.variance
    return compare_report.Errors(
        metrics.relmse(image, truth, reference_variance=variance),
        metrics.trimmed_relmse(image, truth, reference_variance=variance),
    )


def _render_reference(view: View, spp: int, report: Progress) -> ReferenceImage:
    """Render with `path` in batches, without Russian roulette, from seeds of its own."""
    most = min(REFERENCE_BATCH, spp // LEAST_BATCHES)
    batches = [most] * (spp // most) + ([spp % most] if spp % most else [])
    variants = {n: Variant("path", n, {**view.shared, **ENDLESS}) for n in dict.fromkeys(batches)}
    renderers = {n: _renderer(view, REFERENCE, variant) for n, variant in variants.items()}
    mean = BatchMean(view.size)
    for index, samples in enumerate(batches):
        image, _ = renderers[samples].frame(seed_of(view.study.seed, REFERENCE_KEY, index))
        mean.add(imageio.with_rgb(image, 0), samples)
        report(mean.samples, spp, "reference")
    return mean.image()


def _make_reference(view: View, options: argparse.Namespace) -> int:
    spp, depths = options.reference_spp, {"max_depth": view.study.max_depth, **view.shared}
    with rendering(), progress_bar("reference") as report:
        image = _render_reference(view, spp, report).image
    metadata = {"integrator": f"path {depths}", "spp": str(spp), "scene": options.scene}
    data = imageio.encode_exr(image.astype(np.float32), metadata=metadata, half=True)
    imageio.write_atomically(options.make_reference, data)
    print(f"{options.make_reference}: {spp} samples per pixel by path, {depths}")
    return 0


def _embedded_reference(view: View, options: argparse.Namespace) -> Image | None:
    """Return the reference inside the package, where it is one of exactly this picture."""
    own = load_study("compare")
    if (options.scene, view.size, options.sensor) != (own.scene, own.sizes[0], 0):
        return None
    if view.shared not in ({}, {"max_depth": own.max_depth}) or not mi.variant().endswith("rgb"):
        return None
    name = f"{own.scene}_{view.size[0]}x{view.size[1]}.exr"
    resource = importlib.resources.files("mitsuba_restir") / "resources" / name
    with importlib.resources.as_file(resource) as path:
        return imageio.read_rgb(path) if path.is_file() else None


def _show(
    view: View, folder: Path, source: str, rows: list[compare_report.Row], reference: ReferenceImage
) -> None:
    """Write and print everything, with a warning where the reference is too noisy for it."""
    size = f"{view.size[0]}x{view.size[1]}"
    depth = view.shared.get("max_depth", view.study.max_depth)
    title = f"{view.study.scene}, {size}, depth {depth}"
    compare_report.write(folder, title, rows, reference.image.astype(np.float32))
    console = Console()
    console.print(compare_report.table(title, source, rows))
    means = {row.label: [row.mean] for row in rows}
    study = view.study
    data = Measured(size, {}, study.baseline, {}, reference, study.epsilon, study.trim)
    if text := excess(shares(data, means, trimmed)):
        print(f"mitsuba-restir: do not rely on relMSE of mean: {text}", file=sys.stderr)
    console.print(f"Pictures and numbers: {folder / compare_report.STRIP} and beside it")
