"""What a still's frames are rendered with: named plans, and plans in the words of a user."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..integrators.declaration import LARGEST, Parameter, Value
from ..integrators.parameters import PARAMETERS

MIXED = ("candidates", "first_round")
"""AOV types of the estimates that a frame gives beside its picture, first to last."""

SPP = Parameter("spp", 8, "Candidate trees per pixel and frame.", low=1, high=LARGEST)

PLANNED = (
    "spatial",
    "spatial_neighbors",
    "spatial_rounds",
    "spatial_shrink",
    "spatial_radius",
    "neighbor_sampling",
    "shift",
    "connectability",
    "rr_depth",
    "roulette",
    "guiding",
    "mutations",
    "mutation_step",
    "mutation_surrogates",
    "mutation_interval",
    "blue_noise_seeds",
)
"""Parameters that a plan may set: those that leave the frames independent and unbiased."""


@dataclass(frozen=True)
class Plan:
    """
    What a still's frames are rendered with.

    Attributes
    ----------
    name : str
    spp : int
        Candidate trees per pixel and frame.
    parameters : mapping
        Parameters of ``restir_pt`` beside ``temporal``, which is off in every still.
    """

    name: str
    spp: int
    parameters: Mapping[str, Value] = field(default_factory=dict)

    @property
    def mixes(self) -> bool:
        """Whether a frame gives more than one estimate of the picture."""
        return bool(self._value("spatial"))

    @property
    def learns(self) -> bool:
        """Whether its frames learn from earlier ones."""
        return bool(self._value("guiding")) or self._value("roulette") == "contribution"

    @property
    def integrator(self) -> dict[str, Value]:
        """All parameters of its integrator, with the auxiliary images of the other estimates."""
        aovs = {"aovs": ",".join(MIXED)} if self.mixes else {}
        return {**self.parameters, "temporal": False, **aovs}

    def describe(self) -> str:
        """The plan in one line."""
        trees = f"{self.spp} {'trees' if self.spp > 1 else 'tree'} a pixel"
        if not self.mixes:
            reuse = "no reuse"
        else:
            rounds, neighbors, radius, shrink = (
                self._value(f"spatial_{what}")
                for what in ("rounds", "neighbors", "radius", "shrink")
            )
            reuse = f"rounds {rounds}, neighbours {neighbors}, radius {radius:g}"
            reuse += f" x {shrink:g} a round" if shrink != 1 else ""
        drawn = [", guided"] if self._value("guiding") else []
        drawn += [", roulette by contribution"] if self._value("roulette") == "contribution" else []
        return f"{self.name}: {trees}, {reuse}{''.join(drawn)}"

    def _value(self, name: str) -> Value:
        return self.parameters.get(name, PARAMETERS[name].default)


def shared(
    name: str, spp: int, neighbors: int, rounds: int, radius: float, shrink: float = 1.0
) -> Plan:
    """A plan with spatial reuse; the radius of the first round in pixels."""
    return Plan(
        name,
        spp,
        {
            "spatial_neighbors": neighbors,
            "spatial_rounds": rounds,
            "spatial_radius": float(radius),
            "spatial_shrink": shrink,
        },
    )


def guided(plan: Plan) -> Plan:
    """The plan with candidates that learn from earlier frames."""
    parameters = {**plan.parameters, "guiding": True, "roulette": "contribution"}
    return Plan(f"{plan.name}_guided", plan.spp, parameters)


_UNGUIDED = (
    Plan("candidates", 4, {"spatial": False}),
    shared("light", 9, 3, 1, 20),
    shared("wide", 8, 3, 2, 20, 0.5),
    shared("shared", 8, 6, 4, 14, 0.5),
    shared("rounds", 8, 6, 5, 14, 0.6),
    shared("trees", 16, 6, 5, 14, 0.6),
)

PLANS = {plan.name: plan for plan in (*_UNGUIDED, *map(guided, _UNGUIDED))}
"""The named plans, from no reuse to much.

Rounds that look less and less far: relative variance of the luminance of 16 frames of 160x90 after
the mixture, without the worst 0.1 %, of ``rounds`` against equal radii of 10 pixels: Veach Ajar
0.54, its ceiling 0.63, ``ajar`` 0.88, ``court`` 0.87, ``cornell`` 0.76, ``gloss`` 1.00; radii that
grow: 1.02 and 1.09 in Veach Ajar. Neighbours of the same shape only, or of stricter normals and
depths: 0.98 to 1.18. Nine rounds of 3 neighbours have about the luminance's variance of five of 6,
and more noise in colour, which a round's mean over its neighbours takes away. Neighbours drawn by
their contributions from pools of 32 (stochastic pairwise MIS, 5 of them and one shift for the
canonical sample instead of 6 pairs): 0.97 in Veach Ajar, reading the pools aside; 0.72 of a single
round, but later rounds find light everywhere."""


def parse(text: str) -> Plan:
    """
    The plan that a user names or spells out.

    Parameters
    ----------
    text : str
        A name of :data:`PLANS`, or ``name=value`` for ``spp`` and parameters of ``restir_pt``,
        separated by commas; what is left out has its default.

    Raises
    ------
    ValueError
        It is neither; says what is allowed.
    """
    text = text.strip()
    if text in PLANS:
        return PLANS[text]
    declared = {"spp": SPP, **{name: PARAMETERS[name] for name in PLANNED}}
    allowed = f"use one of {', '.join(PLANS)}, or values of {', '.join(declared)}"
    values: dict[str, Value] = {}
    for entry in text.split(","):
        name, equals, word = (part.strip() for part in entry.partition("="))
        if not equals:
            raise ValueError(f"there is no plan '{entry.strip()}'; {allowed}")
        if name not in declared:
            raise ValueError(f"a plan has no '{name}'; {allowed}")
        if name in values:
            raise ValueError(f"{name} is given twice")
        parameter = declared[name]
        value = parameter.parse(word)
        try:
            values[name] = parameter.check(word if value is None else value)
        except ValueError as error:
            raise ValueError(str(error).replace("restir_pt: ", "")) from error
    spp = values.pop("spp", SPP.default)
    return Plan(text, int(spp), values)
