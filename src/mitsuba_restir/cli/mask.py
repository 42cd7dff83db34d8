"""``mitsuba-restir mask``: write a blue-noise mask, its spectrum, and both beside white noise."""

from __future__ import annotations

import argparse
import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.console import Console

from .. import imageio
from ..analysis.spectrum import power_spectrum, radial_spectrum
from ..sampling import masks
from ..sampling.void_cluster import Ranks
from . import mask_figure, output
from .arguments import integer


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "mask",
        help="write a blue-noise mask and its spectrum",
        description="Write a mask (ranks as npy, values as EXR and PNG), its power spectrum (PNG, "
        "and radial means as CSV), and a labelled picture of both beside white noise.",
    )
    parser.add_argument(
        "-o", dest="output", metavar="FOLDER", default="out/mask", help="folder (out/mask)"
    )
    parser.add_argument(
        "--kind",
        choices=list(masks.KINDS),
        default="void_and_cluster",
        help="how it is made (void_and_cluster)",
    )
    parser.add_argument(
        "--size",
        metavar="N",
        type=integer(masks.MIN_SIZE, masks.MAX_SIZE),
        default=masks.SIZE,
        help=f"side in pixels ({masks.SIZE}); smaller tiles leave combs in an image's spectrum",
    )
    parser.add_argument("--seed", metavar="N", type=integer(0), default=0, help="seed (0)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Make or read the mask and write everything; 0 when all is written."""
    folder = Path(options.output)
    output.prepare_folder(folder)
    with Console(stderr=True).status(f"{options.kind} mask, {options.size}x{options.size}"):
        ranks = masks.load_mask(options.kind, options.size, options.seed)
    shown = {options.kind: ranks}
    if options.kind != "white":
        shown = {"white": masks.white(options.size, options.seed), **shown}
    panels = [mask_figure.Panel(name, mask, _spectrum(mask)) for name, mask in shown.items()]
    name = f"{options.kind}-{options.size}"
    figure = folder / f"{name}-figure.png"
    files = _mask_files(folder / name, ranks, panels[-1].spectrum)
    files[figure] = imageio.encode_png(mask_figure.draw(panels))
    for path, data in files.items():
        imageio.write_atomically(path, data)
    print(f"{figure}, and the mask and its spectrum beside it")
    return 0


def _spectrum(ranks: Ranks) -> npt.NDArray[np.float64]:
    """Power spectrum of a mask relative to that of white noise of equal variance."""
    values = masks.mask_values(ranks)
    return power_spectrum(values, window="none") / float(values.var())


def _mask_files(stem: Path, ranks: Ranks, spectrum: npt.NDArray[np.float64]) -> dict[Path, bytes]:
    """Files of one mask, by path."""
    array = io.BytesIO()
    np.save(array, ranks)
    values = masks.mask_values(ranks)
    contents = {
        ".npy": array.getvalue(),
        ".exr": imageio.encode_exr(values[..., None], ["Y"]),
        ".png": imageio.encode_png(mask_figure.mask_grey(ranks)),
        "-spectrum.png": imageio.encode_png(mask_figure.spectrum_grey(spectrum)),
        "-spectrum.csv": _radial_csv(spectrum),
    }
    return {stem.with_name(stem.name + suffix): data for suffix, data in contents.items()}


def _radial_csv(spectrum: npt.NDArray[np.float64]) -> bytes:
    radial = radial_spectrum(spectrum)
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["cycles_per_pixel", "power_relative_to_white", "anisotropy"])
    rows = np.stack([radial.frequency, radial.power, radial.anisotropy], axis=1)
    writer.writerows([f"{value:.6g}" for value in row] for row in rows)
    return text.getvalue().encode()
