"""Redistribution by rank on a real scene: does it survive real shifts?

Final reservoirs of a frame are permuted inside blocks of B x B pixels: the source rank is that of
the relative estimate lum(F W) / r, the destination rank that of a blue-noise mask with a random
offset and a random cyclic rotation, and the path is shifted to where it goes. Prints powers of the
relative error (clipped at 4) relative to the plain average of the same frames, for

- all: every pair whose shift is defined both ways; other pixels keep their own estimate;
- near: of these only pairs with a Jacobian and a ratio of estimates within 10 % of one;
- mis: the received path and the pixel's own, mixed by pairwise MIS (exact).

Usage: redistribution.py SCENE.xml REFERENCE.exr [ceiling|whole] [chains]
"""

from __future__ import annotations

import sys


import mitsuba_restir  # noqa: F401  isort: skip
import drjit as dr
import mitsuba as mi
import numpy as np
from scipy.ndimage import gaussian_filter

mi.set_variant("llvm_ad_rgb")

from mitsuba_restir.analysis.spectrum import power_spectrum  # noqa: E402
from mitsuba_restir.passes.reuse import similar  # noqa: E402
from mitsuba_restir.paths.primary_hit import PrimaryHit  # noqa: E402
from mitsuba_restir.resampling.reservoir import Reservoir  # noqa: E402
from mitsuba_restir.sampling.masks import load_mask  # noqa: E402
from mitsuba_restir.shifts.hybrid import shift  # noqa: E402

WIDTH, HEIGHT, WARMUP, CLIP = 320, 180, 50, 4.0
BLOCKS = (2, 4, 8, 16)
BANDS = ((0.02, 0.06), (0.06, 0.17), (0.25, 0.5))
LUMINANCE = np.array([0.212671, 0.715160, 0.072169])


def make_sensor(scene, view):
    film = {
        "type": "hdrfilm",
        "width": WIDTH,
        "height": HEIGHT,
        "pixel_format": "rgb",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }
    if view == "ceiling":
        to_world = mi.ScalarTransform4f().look_at([3.5, 1.6, -2.3], [0.5, 3.2, -2.3], [0, 1, 0])
        fov = 60.0
    else:
        values = mi.traverse(scene.sensors()[0])
        to_world = mi.ScalarTransform4f(np.array(values["to_world"].matrix).reshape(4, 4))
        fov = float(values["x_fov"][0])
    return mi.load_dict(
        {"type": "perspective", "fov": fov, "fov_axis": "x", "to_world": to_world, "film": film}
    )


def permutation(key, block, mask, rng):
    """Index of the pixel whose path each pixel receives."""
    dy, dx = rng.integers(block, size=2)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    number = ((y + dy) // block) * 1000 + (x + dx) // block
    offset = rng.integers(len(mask), size=2)
    level = mask[(y + offset[0]) % len(mask), (x + offset[1]) % len(mask)]
    flat = number.ravel()
    source = np.lexsort((key.ravel(), flat))
    target = np.lexsort((level.ravel(), flat))
    start = np.searchsorted(flat[source], flat[source])
    size = np.searchsorted(flat[source], flat[source], side="right") - start
    turn = rng.integers(1 << 30, size=flat.max() + 1)[flat[source]]
    rank = np.arange(flat.size) - start
    moved = np.empty(flat.size, dtype=np.uint32)
    moved[target] = source[start + (rank + turn) % size]
    return moved


def lum(color):
    return np.array(color).T @ LUMINANCE


def variants(scene, integrator, source):
    """Images (H, W) of the three rules for a permutation."""
    history, mapping = integrator._history, integrator._plan.mapping
    mine, hits = history.reservoirs, history.hits
    index = mi.UInt32(source)
    theirs, there = dr.gather(Reservoir, mine, index), dr.gather(PrimaryHit, hits, index)
    alike = similar(hits, there) & similar(there, hits)
    here = shift(scene, None, theirs.path, hits, mapping, alike & (theirs.weight > 0))
    away = shift(scene, None, mine.path, there, mapping, alike & (mine.weight > 0))
    dr.eval(here, away)
    own = lum(mine.color) * np.array(mine.weight)
    received = lum(here.color) * np.array(theirs.weight) * np.array(here.jacobian)
    sent = lum(away.color) * np.array(away.jacobian)
    empty = np.array(theirs.weight) == 0
    both = np.array(alike) & ((received > 0) | empty) & ((sent > 0) | (np.array(mine.weight) == 0))
    estimate = lum(theirs.color) * np.array(theirs.weight)
    ratio = np.where(estimate > 0, received / np.where(estimate > 0, estimate, 1), 1)
    near = both & (abs(np.log(np.where(ratio > 0, ratio, 1e-9))) < np.log(1.1))
    near &= abs(np.log(np.array(here.jacobian))) < np.log(1.1)
    m_there = lum(theirs.color) / np.array(here.jacobian)
    m_there = m_there / np.maximum(m_there + lum(here.color), 1e-30)
    m_own = lum(mine.color) / np.maximum(lum(mine.color) + sent, 1e-30)
    mixed = np.where(np.array(alike), m_there * received + m_own * own, own)
    images = {
        "all": np.where(both, received, own),
        "near": np.where(near, received, own),
        "mis": mixed,
    }
    shares = {"all": both.mean(), "near": near.mean(), "mis": np.array(alike).mean()}
    return {k: v.reshape(HEIGHT, WIDTH) for k, v in images.items()}, shares, own


def main():
    scene_file, reference_file, view = sys.argv[1:4]
    chains = int(sys.argv[4])
    scene = mi.load_file(scene_file, optimize=False)
    sensor = make_sensor(scene, view)
    reference = np.array(mi.Bitmap(reference_file))[..., :3].astype(np.float64) @ LUMINANCE
    if view == "ceiling":
        reference = gaussian_filter(reference, 3)
    smooth = gaussian_filter(reference, 8) + 0.01 * reference.mean()
    mask = load_mask()
    integrator = mi.load_dict({"type": "restir_pt", "max_depth": 10, "mutations": 5})
    rng = np.random.default_rng(1)
    images: dict = {}
    shares: dict = {}
    for chain in range(chains):
        integrator.reset()
        for frame in range(WARMUP):
            mi.render(scene, sensor=sensor, integrator=integrator, spp=1, seed=1000 * chain + frame)
        plain = None
        for block in BLOCKS:
            reservoirs = integrator._history.reservoirs
            own = (lum(reservoirs.color) * np.array(reservoirs.weight)).reshape(HEIGHT, WIDTH)
            plain = own
            source = permutation(own / smooth, block, mask, rng)
            found, share, _ = variants(scene, integrator, source)
            for rule, image in found.items():
                images.setdefault((block, rule), []).append(image)
                shares.setdefault((block, rule), []).append(share[rule])
        images.setdefault((1, "plain"), []).append(plain)
        print("chain", chain, flush=True)

    def measure(image):
        error = np.clip((image - reference) / smooth, -CLIP, CLIP)
        spectrum = power_spectrum(error)
        f = np.hypot(*np.meshgrid(np.fft.fftfreq(HEIGHT), np.fft.fftfreq(WIDTH), indexing="ij"))
        bands = [spectrum[(f >= low) & (f < high)].mean() for low, high in BANDS]
        filtered = np.mean(gaussian_filter(error, 1.5) ** 2)
        return np.array([*bands, np.mean(error**2), filtered])

    base = [measure(image) for image in images[1, "plain"]]
    means = [image.mean() for image in images[1, "plain"]]
    print("block rule share | power ratio", BANDS, "| RMSE | filtered MSE | mean")
    for (block, rule), stack in images.items():
        own = np.array([measure(image) for image in stack])
        ratio = own.mean(0) / np.mean(base, 0)
        error = (own / np.array(base)).std(0) / np.sqrt(len(stack))
        share = np.mean(shares.get((block, rule), [1]))
        mean = np.mean([image.mean() for image in stack]) / np.mean(means) - 1
        print(
            f"{block:3d} {rule:6s} {share:.2f} | "
            + " ".join(f"{r:.2f}+-{e:.2f}" for r, e in zip(ratio[:3], error[:3], strict=True))
            + f" | {ratio[3] ** 0.5:.3f} | {ratio[4]:.2f}+-{error[4]:.2f} | {mean:+.2%}"
        )


main()
