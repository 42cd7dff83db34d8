"""The parameters of ``restir_pt``, each declared once: read, checked and documented from here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..neighbors.strategies import STRATEGIES
from ..passes.decorrelate import RULES
from ..passes.shade import AOVS
from ..paths.record import MAX_EDGES
from .declaration import declarations, declared
from .images import images_of
from .presets import PRESETS, in_words


@dataclass(frozen=True)
class Parameters:
    """Checked parameters of the integrator; the declarations say what each means."""

    preset: str = declared(
        "none",
        f"""Values of other parameters, where these are not given. ``none``: the defaults. ``fast``,
        least time: {in_words("fast")}. ``raw``, least error as it is: {in_words("raw")}.
        ``denoised``, least error after a denoiser: {in_words("denoised")}.""",
        choices=tuple(PRESETS),
    )
    max_depth: int = declared(
        -1,
        """Longest path depth, as in :ref:`path <integrator-path>`: 1 is directly visible emission,
        2 direct illumination, -1 no limit.""",
        low=-1,
    )
    rr_depth: int = declared(
        5, "Depth from which initial candidates are subject to Russian roulette.", low=1
    )
    roulette: str = declared(
        "throughput",
        """Which candidates are ended early, with what the others count more. ``throughput``: as in
        ``path``, from ``rr_depth`` on. ``contribution``: from the second vertex on, those that are
        expected to contribute little to the pixel, by what earlier frames have found where they
        are.""",
        choices=("throughput", "contribution"),
    )
    hide_emitters: bool = declared(
        False,
        """Hide directly visible emitters; the environment also behind what a ray passes through
        (masks, thin glass).""",
    )
    temporal: bool = declared(True, "Reuse the paths of earlier frames.")
    spatial: bool = declared(True, "Reuse the paths of neighbouring pixels.")
    spatial_neighbors: int = declared(
        3, "Neighbours requested per pixel and round.", low=1, high=32
    )
    spatial_radius: float = declared(
        20.0, "Radius of the disk they are drawn from [pixels].", low=1, high=256
    )
    spatial_rounds: int = declared(1, "Rounds of spatial reuse per frame.", low=1, high=16)
    spatial_shrink: float = declared(
        1.0,
        """Radius of each further round, as a share of the one before (but at least a pixel). Rounds
        that look less and less far leave less noise than equal ones.""",
        low=0.1,
        high=1,
    )
    spatial_feedback: int = declared(
        16,
        """How many of these rounds the history goes through; the others are for display only.
        With fewer, frames are noisier as they are and cleaner after a denoiser.""",
        high=16,
    )
    neighbor_sampling: str = declared(
        "random",
        """Who the neighbours are. ``random``: reciprocal pairs. ``blue_noise``: pixels exchange
        paths in scattered groups, in the order that a blue-noise mask with a random offset gives
        them: less noise between 1/16 and 1/6 cycles per pixel, at as many shifts and no bias. For
        comparison: ``white_noise``, the same with a white mask; ``blocks``, with a white mask in
        blocks of 16 x 16 pixels (histogram stratification, after Salaün et al. 2025);
        ``geometry``, picks with good scores of the G-buffer (Junkins et al. 2026), at two shifts a
        neighbour.""",
        choices=tuple(STRATEGIES),
    )
    confidence_cap: float = declared(
        20.0,
        "Largest confidence of the history, relative to the frame's own candidates.",
        high=1e6,
    )
    shift: str = declared(
        "hybrid",
        "Shift mapping: ``hybrid``, ``reconnection`` or ``random_replay``.",
        choices=("hybrid", "reconnection", "random_replay"),
    )
    connectability: str = declared(
        "footprint",
        "Test for the reconnection vertex: ``footprint`` or ``distance_roughness``.",
        choices=("footprint", "distance_roughness"),
    )
    retrace_history: bool = declared(
        False,
        """Trace the history's paths again in the current scene before they are reused. Needed where
        the scene changes between frames and :py:meth:`reset` is not called. Unbiased where the
        integrator is told of the edits (``mitsuba_restir.sequence``); otherwise the frame of a
        change is too dark where light reaches what it did not reach.""",
    )
    guiding: bool = declared(
        False,
        """Draw some of the candidates' directions from what earlier frames found. The image's
        expectation stays the same.""",
    )
    mutations: int = declared(
        0,
        """Metropolis-Hastings mutations per pixel and frame, between temporal and spatial reuse
        (Sawhney et al. 2024). They decorrelate the pixels at no bias.""",
        high=1000,
    )
    mutation_step: float = declared(
        0.05, "Standard deviation of a mutation in primary sample space.", low=1e-4, high=1
    )
    mutation_surrogates: int = declared(
        0,
        """Steps before each of these that need no ray, in the plane of the vertex that is moved and
        on a simpler target function; the true step then accepts or refuses where they lead (Liu
        2001). As unbiased as without.""",
        high=1000,
    )
    mutation_interval: int = declared(
        1,
        """Mutate only the n-th part of the pixels per frame, in sets that alternate so that every
        pixel has its turn once in n frames. Cheaper, and as unbiased as all.""",
        low=1,
        high=64,
    )
    mutation_acceptance: str = declared(
        "metropolis",
        """Which mutations are accepted. ``metropolis``: by the rule of Metropolis and Hastings,
        which keeps the image unbiased. ``energy``: by a rule that prefers paths unlike those of
        the neighbours (Fickel). It is here as a negative result: **it biases the image**, and the
        noise does not become blue. It compares with the neighbours' luminances before the
        mutations; ``energy_updated`` is an experiment that keeps them up to date, a sixteenth of
        the pixels moving at a time. Both need ``mutations`` of all pixels. What is shown of the
        result is the business of ``blue_noise``, and each goes with each.""",
        choices=tuple(RULES),
        biased=lambda parameters: parameters.prefers_energy and parameters.blue_noise_weight > 0,
    )
    blue_noise: str = declared(
        "none",
        """What is shown. ``none``: the plain average of the estimates that spatial reuse has made.
        ``selection``: of these, the one that moves the error to high frequencies, steered by a
        colour history of plain averages. Nothing of it gets into reservoirs or history. **What is
        shown is biased**: the picture has the mean of the plain frame, but parts of it err by about
        0.3 % (20x20 pixels of Veach Ajar's ceiling; 1 % beside heavy tails, more while a
        history is young and behind shadows that move). It needs ``spatial`` and ``temporal``.""",
        choices=("none", "selection"),
        former={
            "mutation": "mutation_acceptance='energy'",
            "mutation_updated": "mutation_acceptance='energy_updated'",
        },
        biased=lambda parameters: parameters.selects,
    )
    blue_noise_sigma: float = declared(
        0.8,
        """Standard deviation [pixels] of the Gaussian through which ``selection`` sees errors:
        smaller for who looks from near, whose noise is then less; larger from afar.""",
        low=0.5,
        high=1.5,
    )
    blue_noise_weight: float = declared(
        0.5,
        """Share of the energy in the acceptance probability of ``mutation_acceptance``, from 0
        (Metropolis-Hastings, unbiased) to 1.""",
        high=1,
    )
    blue_noise_seeds: bool = declared(
        False,
        """Take the first random numbers of every candidate path from blue-noise masks with random
        offsets (Georgiev and Fajardo 2016). The expectation stays the same.""",
    )
    aovs: str = declared(
        "",
        "Auxiliary images as ``name:type, ...`` with the types "
        + ", ".join(f"``{name}``{aov.doc and f' ({aov.doc})'}" for name, aov in AOVS.items())
        + ".",
    )

    @property
    def longest(self) -> int:
        """Edges of the longest path that is traced."""
        return MAX_EDGES if self.max_depth == -1 else min(self.max_depth, MAX_EDGES)

    @property
    def cuts(self) -> bool:
        """Whether longer paths were asked for than records have room for."""
        return self.max_depth == -1 or self.max_depth > MAX_EDGES

    @property
    def radii(self) -> tuple[float, ...]:
        """Radius of each round of spatial reuse [pixels]."""
        rounds = range(self.spatial_rounds if self.spatial else 0)
        return tuple(max(1.0, self.spatial_radius * self.spatial_shrink**i) for i in rounds)

    @property
    def mutates(self) -> bool:
        """Whether there are mutations."""
        return self.mutations > 0

    @property
    def prefers_energy(self) -> bool:
        """Whether mutations are accepted by the source document's rule."""
        return self.mutation_acceptance != "metropolis"

    @property
    def selects(self) -> bool:
        """Whether one of the estimates of spatial reuse is chosen to be shown."""
        return self.blue_noise == "selection"

    @property
    def images(self) -> tuple[tuple[str, str], ...]:
        """Name and type of each auxiliary image; as in Mitsuba's ``aov``, a type is a name too."""
        return images_of(self.aovs)

    def shows(self, kind: str) -> bool:
        """Whether an auxiliary image of a type is asked for."""
        return any(shown == kind for _, shown in self.images)

    @property
    def biased(self) -> tuple[str, ...]:
        """What was asked for that biases the image, as ``name=value``."""
        return tuple(
            f"{name}={getattr(self, name)}"
            for name, declaration in PARAMETERS.items()
            if declaration.biased(self)
        )


PARAMETERS = declarations(Parameters)
"""The declarations by name."""


def read_parameters(props: Any) -> Parameters:
    """Read and check the plugin's properties.

    Raises
    ------
    ValueError
        For an unknown name or a value outside the allowed range, naming what is allowed.
    """
    found = {name: props.get(name, None) for name in PARAMETERS}
    parameters = resolve({name: value for name, value in found.items() if value is not None})
    if unknown := props.unqueried():
        known = ", ".join(PARAMETERS)
        raise ValueError(f"restir_pt has no parameter '{unknown[0]}'; it has {known}")
    return parameters


def resolve(given: Mapping[str, Any]) -> Parameters:
    """All parameters, where only these are given; errors as of :func:`read_parameters`."""
    preset = PARAMETERS["preset"]
    defaults = PRESETS[str(preset.check(given.get("preset", preset.default)))]
    values: dict[str, Any] = {
        name: declaration.check(given.get(name, defaults.get(name, declaration.default)))
        for name, declaration in PARAMETERS.items()
    }
    parameters = Parameters(**values)
    _check_together(parameters)
    return parameters


def _check_together(parameters: Parameters) -> None:
    """Refuse values that do not go together."""
    rule = f"restir_pt: mutation_acceptance={parameters.mutation_acceptance!r}"
    if parameters.prefers_energy and not parameters.mutates:
        raise ValueError(f"{rule} is a rule for mutations and needs mutations of at least 1, not 0")
    if parameters.prefers_energy and parameters.mutation_interval > 1:
        raise ValueError(
            f"{rule} mutates every pixel in every frame and needs mutation_interval=1, not "
            f"{parameters.mutation_interval}"
        )
    if parameters.selects and not (parameters.temporal and parameters.spatial):
        raise ValueError(
            "restir_pt: blue_noise='selection' chooses among what spatial reuse computes, by what "
            "earlier frames showed, and needs temporal=true and spatial=true"
        )
    for name, kind in parameters.images:
        if kind not in AOVS:
            item = name if name == kind else f"{name}:{kind}"
            types = "a list of name:type with types " + ", ".join(AOVS)
            raise PARAMETERS["aovs"].refusal(item, types)
        if AOVS[kind].selects and not parameters.selects:
            raise ValueError(f"restir_pt: the aov type {kind} needs blue_noise='selection'")
