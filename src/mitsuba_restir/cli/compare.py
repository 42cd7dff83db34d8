"""``mitsuba-restir compare``: variants side by side, with their errors and times."""

from __future__ import annotations

import argparse
import importlib.resources
import statistics
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.progress import track

from .. import imageio
from ..analysis import metrics
from ..errors import UsageError, rendering
from ..imageio import Image
from ..studies.measure.noise import excess, shares, trimmed
from ..studies.measure.results import Measured
from ..studies.runs.batches import LEAST_BATCHES, BatchMean
from ..studies.runs.results import ReferenceImage
from . import compare_report, loading, output
from .arguments import as_dict, integer
from .parameters import Value, parse_parameters
from .render import add_scene_arguments

MAX_DEPTH = 10
"""Path length of every variant and of the reference where ``-p max_depth`` does not say else."""

SHARED_PARAMETERS = ("max_depth", "rr_depth", "hide_emitters")
"""Parameters that `path` has too."""

DEFAULT_SIZE = (256, 144)
DEFAULT_SCENE = "ajar"
REFERENCE_BATCH = 32

_ReuseOff = dict[str, Value]
VARIANTS: tuple[tuple[str, str, _ReuseOff], ...] = (
    ("path", "path", {}),
    ("candidates", "restir_pt", {"temporal": False, "spatial": False}),
    ("spatial", "restir_pt", {"temporal": False}),
    ("spatiotemporal", "restir_pt", {}),
)


@dataclass
class Run:
    """
    One variant while it renders.

    Fields
    ------
    label, kind : str
        Name for the reader, and plugin.
    integrator : mi.Integrator
    seconds : list of float
        Time of each frame.
    errors : list of Errors
        Of each frame.
    total : array, (H, W, 3)
        Sum of the frames.
    last : array, (H, W, 3)
        The last frame.
    """

    label: str
    kind: str
    integrator: Any
    seconds: list[float] = field(default_factory=list)
    errors: list[compare_report.Errors] = field(default_factory=list)
    total: npt.NDArray[np.float64] | None = None
    last: Image | None = None

    def add(self, image: Image, seconds: float, reference: ReferenceImage) -> None:
        """Take one frame."""
        self.seconds.append(seconds)
        self.errors.append(_errors(image, reference))
        self.last = image
        self.total = image + (np.zeros(image.shape) if self.total is None else self.total)

    def row(self, reference: ReferenceImage) -> compare_report.Row:
        """Summarise: medians of time over the frames after compilation, errors at the end."""
        assert self.last is not None
        assert self.total is not None
        frames = len(self.seconds)
        # The first two frames compile: the second is the first that has a history.
        warm = self.seconds[2:] or self.seconds[-1:]
        tail = self.errors[-max(1, frames // 4) :]
        mean = (self.total / frames).astype(np.float32)
        errors = compare_report.Errors(
            statistics.fmean(entry.relmse for entry in tail),
            statistics.fmean(entry.trimmed for entry in tail),
        )
        milliseconds = 1000.0 * statistics.median(warm)
        return compare_report.Row(
            self.label, milliseconds, errors, _errors(mean, reference), frames, self.last, mean
        )


def _errors(image: Image, reference: ReferenceImage) -> compare_report.Errors:
    truth, variance = reference.image, reference.variance
    return compare_report.Errors(
        metrics.relmse(image, truth, reference_variance=variance),
        metrics.trimmed_relmse(image, truth, reference_variance=variance),
    )


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
    console = Console()
    definitions = as_dict(options.definitions, "-D")
    parameters: dict[str, Value] = {
        "max_depth": MAX_DEPTH,
        **parse_parameters(as_dict(options.parameters, "-p")),
    }
    depths = {name: value for name, value in parameters.items() if name in SHARED_PARAMETERS}
    folder = Path(options.output or f"out/compare-{Path(options.scene).stem}")
    if options.make_reference and options.make_reference.suffix.lower() != ".exr":
        raise UsageError("argument --make-reference: the name must end in .exr")
    loading.choose_variant(options.variant)
    runs = []
    for label, kind, reuse in VARIANTS:
        own = depths if kind == "path" else parameters
        runs.append(Run(label, kind, loading.make_integrator(kind, {**own, **reuse})))
    given = imageio.read_rgb(options.reference) if options.reference else None
    size = options.resolution or (given.shape[1::-1] if given is not None else DEFAULT_SIZE)
    scene = loading.load_scene(options.scene, definitions, size)
    sensor = loading.choose_sensor(scene, options.sensor)
    if given is not None and given.shape[1::-1] != size:
        raise UsageError(
            f"argument --reference: {options.reference} has {given.shape[1]}x{given.shape[0]} "
            f"pixels, the images have {size[0]}x{size[1]}"
        )
    output.prepare_folder(options.make_reference.parent if options.make_reference else folder)
    with rendering():
        if options.make_reference:
            spp = options.reference_spp
            image = _render_reference(scene, sensor, depths, spp, options.seed).image
            metadata = {"integrator": f"path {depths}", "spp": str(spp), "scene": options.scene}
            data = imageio.encode_exr(image.astype(np.float32), metadata=metadata, half=True)
            imageio.write_atomically(options.make_reference, data)
            console.print(f"{options.make_reference}: {spp} samples per pixel by path, {depths}")
            return 0
        source = f"{options.reference}, whose own error is in all errors"
        if given is None:
            given = _embedded_reference(options.scene, size, depths, options.sensor)
            source = "the committed one, whose own error is in all errors"
        if given is None:
            spp = options.reference_spp
            reference = _render_reference(scene, sensor, depths, spp, options.seed)
            source = f"path, {spp} samples per pixel, whose own error is subtracted"
        else:
            reference = ReferenceImage(given.astype(np.float64), np.zeros(given.shape))
        _render_all(runs, scene, sensor, options.frames, options.seed, reference)
    rows = [entry.row(reference) for entry in runs]
    title = f"{options.scene}, {size[0]}x{size[1]}, depth {depths['max_depth']}"
    compare_report.write(folder, title, rows, reference.image.astype(np.float32))
    console.print(compare_report.table(title, source, rows))
    means = {row.label: [row.mean] for row in rows}
    settings = metrics.DEFAULT_EPSILON, metrics.DEFAULT_TRIM
    measured = Measured(f"{size[0]}x{size[1]}", {}, runs[0].label, {}, reference, *settings)
    if text := excess(shares(measured, means, trimmed)):
        print(f"mitsuba-restir: do not rely on relMSE of mean: {text}", file=sys.stderr)
    console.print(f"Pictures and numbers: {folder / compare_report.STRIP} and beside it")
    return 0


def _track(items: Sequence[int], label: str) -> Iterable[int]:
    console = Console(stderr=True)
    return track(items, label, console=console, transient=True, disable=not console.is_terminal)


def _path_seed(seed: int) -> Any:
    """Wrap a seed for `path`: an int would be compiled into the kernel, anew for every frame."""
    return dr.opaque(mi.UInt32, seed % 2**32)


def _render(scene: Any, sensor: Any, integrator: Any, seed: Any, spp: int = 1) -> Image:
    image = mi.render(scene, integrator=integrator, sensor=sensor, spp=spp, seed=seed)
    return imageio.with_rgb(image, 0)


def _render_all(
    runs: list[Run], scene: Any, sensor: Any, frames: int, seed: int, reference: ReferenceImage
) -> None:
    """Render all variants frame by frame in turn, so that a busy machine cannot favour one."""
    for frame in _track(range(frames), "comparing"):
        for entry in runs:
            start = time.perf_counter()
            # restir_pt counts its frames itself: equal seeds still give fresh ones.
            own = _path_seed(seed + frame) if entry.kind == "path" else seed
            image = _render(scene, sensor, entry.integrator, own)
            entry.add(image, time.perf_counter() - start, reference)


def _render_reference(
    scene: Any, sensor: Any, depths: Mapping[str, Value], spp: int, seed: int
) -> ReferenceImage:
    """Render with `path` in batches, without Russian roulette, from seeds of its own."""
    endless = {"rr_depth": 2**31 - 1}
    integrator = loading.make_integrator("path", {**depths, **endless})
    most = min(REFERENCE_BATCH, spp // LEAST_BATCHES)
    batches = [most] * (spp // most)
    batches += [spp % most] if spp % most else []
    mean = BatchMean(sensor.film().crop_size())
    for index, batch in enumerate(_track(batches, "reference")):
        image = _render(scene, sensor, integrator, _path_seed(seed + 2**31 + index), batch)
        mean.add(image, batch)
    return mean.image()


def _embedded_reference(
    scene: str, size: tuple[int, int], depths: Mapping[str, Value], sensor: int
) -> Image | None:
    """Return the reference inside the package, where it is one of exactly this picture."""
    if (scene, size, sensor) != (DEFAULT_SCENE, DEFAULT_SIZE, 0):
        return None
    if dict(depths) != {"max_depth": MAX_DEPTH} or not mi.variant().endswith("rgb"):
        return None
    name = f"{scene}_{size[0]}x{size[1]}.exr"
    resource = importlib.resources.files("mitsuba_restir") / "resources" / name
    with importlib.resources.as_file(resource) as path:
        return imageio.read_rgb(path) if path.is_file() else None
