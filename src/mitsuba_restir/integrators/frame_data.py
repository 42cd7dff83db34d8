"""What the stages of a frame hand to each other, as plain data, and the plan that they share."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import drjit as dr
import mitsuba as mi

from ..guiding.policy import Findings, Learnt, nothing_learnt
from ..mutations.chain import Mutated
from ..mutations.kind import MutationPlan
from ..mutations.proposals import MoveReconnectionVertex
from ..mutations.surrogate import MoveInPlane
from ..neighbors.color_history import ColorHistory, no_color_history
from ..passes.temporal import Previous
from ..paths.camera import eye_of
from ..paths.grid import grid_of
from ..paths.primary_hit import Primary, PrimaryHit, no_primary_hits
from ..paths.record import Form
from ..paths.reshaped import drop_reshaped
from ..paths.settings import PathLimits
from ..paths.spectrum import Spectra
from ..resampling.pairwise import PairEstimators
from ..resampling.reservoir import Reservoir, empty_reservoir
from ..resampling.subsets import Round
from ..sampling.dither import Dither
from ..sampling.streams import FrameKey
from ..shifts.hybrid import Shifted
from ..shifts.mapping import ShiftMapping
from ..shifts.scope import Scope
from .parameters import Parameters
from .scene_watch import Edit


@dataclass
class History:
    """What a frame leaves to the next one, one lane per pixel.

    Fields: ``reservoirs``, ``hits``, ``colors`` (for selection; None without it), ``learnt`` (None
    where candidates are neither guided nor ended by what is known).
    """

    reservoirs: Reservoir
    hits: PrimaryHit
    colors: ColorHistory | None
    learnt: Learnt | None


@dataclass
class Setting:
    """What both stages of a frame are given.

    Fields: ``scene`` (None at the end, where no image looks at it), ``spectra`` (wavelengths; None
    where there are none), ``now`` (the frame's primary hits), ``key``, ``dither`` (of the paths'
    first random numbers; None without).
    """

    scene: mi.Scene | None
    spectra: Spectra | None
    now: Primary
    key: FrameKey
    dither: Dither | None


@dataclass
class Beside:
    """What a frame shows and counts beside what its reservoirs hold.

    Fields: ``direct`` (light seen directly, and candidates that are not finite), ``alpha``,
    ``refused`` (how many candidates and paths of the history were not finite), ``cut`` (pixels with
    a path that ends because records have no room for more), ``lit`` (pixels whose candidates carry
    light), ``candidates`` (what these alone would show; 0 where that is not asked for).
    """

    direct: mi.Color3f
    alpha: mi.Float
    refused: mi.UInt32
    cut: mi.Bool
    lit: mi.Bool
    candidates: mi.Color3f


@dataclass
class Found:
    """Which pixels found their history, one lane per pixel.

    Fields: ``matched`` (those that did), ``moved`` (those whose surface has moved), ``lost`` (those
    whose surface has moved in a way that is not followed).
    """

    matched: mi.Bool
    moved: mi.Bool
    lost: mi.Bool


@dataclass
class Waiting:
    """History before it is merged, over an edit of the scene.

    Fields: ``previous``, ``kept_pdf`` (of the frame's own paths, see
    :func:`mitsuba_restir.shifts.carry.kept_pdf`).
    """

    previous: Previous
    kept_pdf: mi.Float


@dataclass
class LookedBack:
    """What can be known only while the scene before an edit is in place.

    Fields: ``backward`` (the frame's own paths, shifted to the history's pixels), ``kept_pdf`` (of
    the history's paths).
    """

    backward: Shifted
    kept_pdf: mi.Float


@dataclass
class Sampled:
    """A frame after temporal reuse.

    Fields: ``reservoirs``, ``outcomes`` (of the temporal shifts), ``found``, ``flow`` (previous
    minus current film position [pixels]), ``colors`` (at each pixel's previous place; None without
    selection), ``beside``, ``learnt`` (by earlier frames), ``findings`` (what this one can teach),
    ``waiting`` (history that is still to be merged, over an edit of the scene; None where none is).
    """

    reservoirs: Reservoir
    outcomes: list[mi.UInt32]
    found: Found
    flow: mi.Vector2f
    colors: ColorHistory | None
    beside: Beside
    learnt: Learnt | None
    findings: Findings | None
    waiting: Waiting | None


@dataclass
class Changed:
    """A frame after its mutations.

    Fields: ``reservoirs``, ``mutated`` (None without mutations), ``moved`` (channels that show what
    they changed, by auxiliary image).
    """

    reservoirs: Reservoir
    mutated: Mutated | None
    moved: list[list[mi.Float]]


@dataclass
class Shared:
    """A frame after a round of spatial reuse.

    Fields: ``reservoirs``, ``color`` (mean of the pair estimators), ``estimators`` (one entry where
    they are chosen from, none elsewhere), ``outcomes`` (of the shifts).
    """

    reservoirs: Reservoir
    color: mi.Color3f
    estimators: list[PairEstimators]
    outcomes: list[mi.UInt32]


@dataclass
class Rounds:
    """What rounds of spatial reuse leave beside their reservoirs.

    Fields: ``colors`` (of the first and the last, or of all where they are chosen from),
    ``estimators`` (of all then, else none), ``outcomes`` (of the temporal pass and each round).
    """

    colors: list[mi.Color3f]
    estimators: list[PairEstimators]
    outcomes: list[list[mi.UInt32]]

    @property
    def known(self) -> list[Round]:
        """What selection chooses from."""
        return [Round(*each) for each in zip(self.colors, self.estimators, strict=True)]

    @property
    def ends(self) -> Rounds:
        """Without what only selection needs."""
        return Rounds([*self.colors[:1], *self.colors[1:][-1:]], [], self.outcomes)


def after_round(rounds: Rounds, shared: Shared) -> Rounds:
    """The rounds so far, with one more."""
    earlier = rounds.colors if shared.estimators else rounds.colors[:1]
    return Rounds(
        [*earlier, shared.color],
        [*rounds.estimators, *shared.estimators],
        [*rounds.outcomes, shared.outcomes],
    )


@dataclass
class Frame:
    """A rendered frame.

    Fields: ``color``, ``auxiliary`` (channels), ``outcomes`` (of the temporal pass and of each
    spatial round, 3 bits a shift), ``found``, ``mutated`` (None without mutations), ``beside``,
    ``history``, ``rounds`` (of spatial reuse; none unless frames keep them).
    """

    color: mi.Color3f
    auxiliary: list[mi.Float]
    outcomes: list[list[mi.UInt32 | mi.UInt8]]
    found: Found
    mutated: Mutated | None
    beside: Beside
    history: History
    rounds: list[Round] = field(default_factory=list)


@dataclass(frozen=True)
class Plan:
    """What stays the same from frame to frame.

    Attributes
    ----------
    parameters : Parameters
    limits : PathLimits
    mapping : ShiftMapping
    form : Form
        Of records.
    width, height : int
        Size of the crop window [pixels].
    keeps_rounds : bool
        Whether frames keep what selection chooses from, whether or not they select.
    """

    parameters: Parameters
    limits: PathLimits
    mapping: ShiftMapping
    form: Form
    width: int
    height: int
    keeps_rounds: bool = False

    def scope(self, setting: Setting) -> Scope:
        """The scope of a stage."""
        return Scope(
            setting.scene,
            setting.spectra,
            self.mapping,
            self.limits,
            grid_of(self.width, self.height),
            setting.key,
            setting.dither,
        )

    def mutations(self) -> MutationPlan:
        """How paths are mutated."""
        parameters = self.parameters
        plain = MoveReconnectionVertex(parameters.mutation_step)
        surrogates = parameters.mutation_surrogates
        return MutationPlan(
            MoveInPlane(plain, surrogates) if surrogates else plain,
            parameters.mutations,
            parameters.mutation_interval,
            parameters.mutation_acceptance,
            parameters.blue_noise_weight,
        )


def no_history(scene: mi.Scene, sensor: mi.Sensor, plan: Plan) -> History:
    """A history without paths, with the structure that later frames have."""
    parameters, pixels = plan.parameters, plan.width * plan.height
    index = dr.zeros(mi.UInt32, pixels)
    history = History(
        dr.gather(Reservoir, empty_reservoir(plan.form), index),
        no_primary_hits(pixels, eye_of(sensor), plan.form.compact),
        dr.gather(ColorHistory, no_color_history(), index) if parameters.selects else None,
        nothing_learnt(scene, parameters.guiding, parameters.roulette == "contribution"),
    )
    dr.make_opaque(history)
    return history


def without_reshaped(history: History, scene: mi.Scene, edit: Edit) -> tuple[History, mi.Bool]:
    """The history without what goes over reshaped shapes, and the pixels that have lost theirs."""
    hits, dropped = drop_reshaped(
        history.hits,
        history.reservoirs.path,
        edit.reshaped,
        instanced=not set(edit.reshaped) <= set(scene.shapes()),
    )
    dr.eval(hits, dropped)
    return replace(history, hits=hits), dropped
