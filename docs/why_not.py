"""The figure of docs/blue_noise.md: why neither reweighting nor the source document's rule works.

    python docs/why_not.py    # writes docs/why_not.png

Left: power of the error of unbiased choices among four estimates, against that of their mean.
Right: the energy that the rule lowers, of the luminance with the old weight, which nobody sees, and
with the weight that belongs to the new path, which is shown.
"""

# mitsuba_restir brings the LLVM, and comes before mitsuba.
# ruff: noqa: I001

from __future__ import annotations

from pathlib import Path

from mitsuba_restir import scenes
import mitsuba as mi
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reweighting import UNBIASED, biased_in_turn, choice_powers
from mitsuba_restir.analysis.spectrum import radial_spectrum
from mitsuba_restir.sampling.georgiev import image_energy
from mitsuba_restir.sampling.masks import load_mask, mask_values

WEIGHTS = (0.0, 0.25, 0.5, 0.75, 1.0)
FRAMES = 12


def draw_choices(axes: Axes) -> None:
    """Radial spectra of choices, relative to the mean's."""
    mask = mask_values(load_mask(size=128))
    for name, rule in {**UNBIASED, "biased, in turn": biased_in_turn}.items():
        found = choice_powers(rule, mask, estimates=4, realisations=32, seed=1)
        shown, mean = (radial_spectrum(p.mean(axis=0)) for p in (found.shown, found.mean))
        style = "--" if rule is biased_in_turn else "-"
        axes.plot(shown.frequency, shown.power / mean.power, style, label=name)
    axes.axhline(1, color="black", linewidth=0.8)
    axes.set(
        xlabel="cycles per pixel",
        ylabel="power, relative to the mean of the estimates",
        xlim=(0, 0.5),
        yscale="log",
        title="Choices among four estimates",
    )
    axes.legend(frameon=False)


def energies(weight: float) -> tuple[float, float]:
    """Energy after the mutations relative to before: with the old weight, and with the new one."""
    scene = scenes.load("ajar", width=160, height=90)
    integrator = mi.load_dict(
        {
            "type": "restir_pt",
            "max_depth": 6,
            "mutations": 5,
            "mutation_acceptance": "energy",
            "blue_noise_weight": weight,
            "aovs": "m:mutation",
        }
    )
    ratios = []
    for frame in range(FRAMES):
        image = np.array(integrator.render(scene, seed=frame, spp=1), dtype=np.float64)
        before, after, mixed = np.moveaxis(image[..., 3:], -1, 0)
        scale = before.mean()
        e = [image_energy(x / (x + scale)).mean() for x in (before, mixed, after)]
        ratios.append((e[1] / e[0], e[2] / e[0]))
    old, new = np.mean(ratios[FRAMES // 2 :], axis=0)
    return old, new


def draw_energies(axes: Axes) -> None:
    """What the rule lowers, and what becomes of it."""
    old, new = zip(*(energies(weight) for weight in WEIGHTS), strict=True)
    axes.plot(WEIGHTS, old, "o-", label="new luminance, old weight: what the rule compares")
    axes.plot(WEIGHTS, new, "s--", label="new luminance, new weight: what is shown")
    axes.set(
        xlabel="blue_noise_weight",
        ylabel="energy, relative to before the mutations",
        title="The source document's rule",
    )
    axes.legend(frameon=False)


def main() -> None:
    """Draw both."""
    mi.set_variant("llvm_ad_rgb")
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    draw_choices(left)
    draw_energies(right)
    figure.savefig(Path(__file__).with_suffix(".png"), dpi=110)


if __name__ == "__main__":
    main()
