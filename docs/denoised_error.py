"""Why frames that are better as they are can be worse after a denoiser: what their errors share.

    python docs/denoised_error.py SCENE REFERENCE [PARAM=VALUE ...]

renders the 30th frame of a few histories and denoises each of them as it is, with the relative
errors of its pixels shuffled within blocks of 4, 16 and 64 pixels, and with its bright pixels set
right. Shuffling keeps every error and what a block has in common; it takes away what neighbours
have in common. If the denoised error falls by it, correlation has cost the difference. The
reference's own noise is in all of them.
"""

# mitsuba_restir brings the LLVM, and comes before mitsuba.
# ruff: noqa: I001

from __future__ import annotations

import sys
from typing import Any

from mitsuba_restir.cli import loading

import mitsuba as mi
import numpy as np

from mitsuba_restir.analysis.denoise import denoise
from mitsuba_restir.analysis.duplication import duplicated_share
from mitsuba_restir.analysis.images import FloatArray, luminance, smoothed_reference
from mitsuba_restir.analysis.metrics import relmse, trimmed_relmse
from mitsuba_restir.cli.arguments import assignment
from mitsuba_restir.cli.parameters import parse_parameters

BLOCKS = (4, 16, 64)
"""Sides of the blocks in which errors are shuffled [pixels]."""

BRIGHT = 5.0
"""A pixel is bright from so many times the reference around it."""

FRAMES, HISTORIES = 30, 6
AOVS = "albedo,sh_normal,path"


def shuffled(values: FloatArray, block: int, random: np.random.Generator) -> FloatArray:
    """
    Shuffle the pixels of an image within blocks.

    Parameters
    ----------
    values : array, (H, W, C)
    block : int
        Side of a block [pixels].
    random : Generator

    Returns
    -------
    array, (H, W, C)
    """
    result = values.copy()
    height, width = values.shape[:2]
    for y in range(0, height, block):
        for x in range(0, width, block):
            part = result[y : y + block, x : x + block]
            pixels = part.reshape(-1, part.shape[2])
            part[:] = random.permutation(pixels).reshape(part.shape)
    return result


def last_frame(scene: Any, integrator: Any, seed: int) -> FloatArray:
    """Render a history from nothing and return its last frame with auxiliary images."""
    integrator.reset()
    for _ in range(FRAMES):
        image = mi.render(scene, integrator=integrator, spp=1, seed=seed)
    return np.array(image, dtype=np.float64)


def errors(frame: FloatArray, reference: FloatArray, random: np.random.Generator) -> list[float]:
    """
    relMSE as rendered and after the denoiser, and what that would be otherwise.

    Parameters
    ----------
    frame : array, (H, W, 12)
        Colour, albedo, normal and the path numbers.
    reference : array, (H, W, 3)
    random : Generator

    Returns
    -------
    list of float
        Trimmed, as rendered; denoised as it is, shuffled in each of `BLOCKS`, and with bright
        pixels set right; the share of pixels that hold a path which another one nearby holds too.
    """
    colour, albedo, normal, paths = np.split(frame, 4, axis=-1)
    bright = luminance(colour) > BRIGHT * smoothed_reference(luminance(reference))
    relative = colour / np.maximum(reference, 1e-6)
    images = [
        colour,
        *(reference * shuffled(relative, block, random) for block in BLOCKS),
        np.where(bright[..., None], reference, colour),
    ]
    found = [relmse(denoise(image, albedo, normal), reference) for image in images]
    raw = trimmed_relmse(colour, reference)
    return [raw, *found, duplicated_share(paths[..., -1].astype(np.int64))]


def main(source: str, reference_file: str, *assignments: str) -> None:
    """Measure and print."""
    loading.choose_variant(None)
    reference = np.array(mi.Bitmap(reference_file), dtype=np.float64)[..., :3]
    height, width = reference.shape[:2]
    scene = loading.load_scene(source, {}, (width, height))
    parameters = parse_parameters(dict(map(assignment, assignments)))
    integrator = loading.make_integrator("restir_pt", {"max_depth": 10, **parameters, "aovs": AOVS})
    random = np.random.default_rng(0)
    rows = [errors(last_frame(scene, integrator, n), reference, random) for n in range(HISTORIES)]
    names = [
        "raw, trimmed",
        "as it is",
        *(f"shuffled in {b} px" for b in BLOCKS),
        "bright set right",
        "duplicated",
    ]
    for name, values in zip(names, np.transpose(rows), strict=True):
        error = values.std(ddof=1) / np.sqrt(HISTORIES)
        print(f"{name:20s} {values.mean():.4f} +- {error:.4f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
