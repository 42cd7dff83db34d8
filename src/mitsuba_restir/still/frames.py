"""Independent frames of one plan in one scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from ..analysis.denoise import GUIDES
from ..analysis.images import channels_luminance
from ..errors import one_line
from ..integrators.declaration import Value
from ..integrators.images import asking_for
from ..integrators.parameters import PARAMETERS
from ..integrators.recording import frame_alone
from ..integrators.state import State, unpacked
from .accumulate import Layout, Size
from .plan import MIXED, PLANNED, Plan
from .preview import Estimated, Preview, Steering

ALLOWED = ("max_depth", "hide_emitters", *PLANNED)
"""Parameters of ``restir_pt`` that a still may be given: they leave its frames independent and
unbiased."""

PREVIEWS = ("blue_noise", "blue_noise_sigma")
"""Parameters of ``restir_pt`` that say what is shown of a still while it grows."""

_WHY_NOT = {
    "blue_noise": "its picture is the plain mean, and only previews of it are steered",
    "temporal": "its frames are independent, temporal reuse is off",
    "preset": "it has plans instead",
}


@dataclass(frozen=True)
class Subject:
    """
    What a still is of.

    Attributes
    ----------
    scene : Scene
    sensor : Sensor
    seed : int
    parameters : mapping
        Of ``restir_pt``, set whatever the plan says.
    aovs : mapping of str to str
        Auxiliary images that are wanted: name to type.
    guides : bool
        Whether a denoiser's guides are wanted as well.
    previewed : float or None
        Standard deviation [pixels] of the Gaussian through which the error of a preview is blue;
        None where none is wanted.
    """

    scene: mi.Scene
    sensor: mi.Sensor
    seed: int
    parameters: Mapping[str, Value] = field(default_factory=dict)
    aovs: Mapping[str, str] = field(default_factory=dict)
    guides: bool = False
    previewed: float | None = None

    @property
    def lit(self) -> bool:
        """Whether there is any light in the scene."""
        with frame_alone():
            return bool(self.scene.emitters())

    def planned(self, plan: Plan) -> Plan:
        """The plan with the parameters that are set whatever it says."""
        own = {name: value for name, value in self.parameters.items() if name in PLANNED}
        return replace(plan, parameters={**plan.parameters, **own}) if own else plan

    def images(self, plan: Plan) -> dict[str, str]:
        """All auxiliary images that frames of a plan need, name to type; those wanted first."""
        images = dict(self.aovs)
        for kind in (*(GUIDES if self.guides else ()), *(MIXED if plan.mixes else ())):
            if kind not in images.values():
                images[f"still_{kind}"] = kind
        return images


def check_parameters(parameters: Mapping[str, Any]) -> None:
    """
    Refuse parameters that would make frames dependent or biased.

    Raises
    ------
    ValueError
        There is one; says why, and what is allowed.
    """
    for name, value in parameters.items():
        if name not in ALLOWED and (name, value) != ("temporal", False):
            why = f": {_WHY_NOT[name]}" if name in _WHY_NOT else ""
            raise ValueError(
                f"a still cannot have {name}={value}{why}; it can have {', '.join(ALLOWED)}"
            )


def previewed(parameters: Mapping[str, Value]) -> float | None:
    """
    What these parameters of ``restir_pt`` ask of previews, see `Subject`.

    Raises
    ------
    ValueError
        One of :data:`PREVIEWS` has a value that is not allowed.
    """
    kind, sigma = (
        PARAMETERS[name].check(parameters.get(name, PARAMETERS[name].default)) for name in PREVIEWS
    )
    return float(sigma) if kind == "selection" else None


class Frames:
    """
    Renders the frames of a plan.

    Parameters
    ----------
    subject : Subject
    plan : Plan

    Attributes
    ----------
    size : (int, int)
        Height and width [pixels].
    lit : bool
        Whether there is any light in the scene.
    layout : Layout
        Of a frame's channels.
    images : dict of str to slice
        Which of the layout's extra channels are those of an auxiliary image that is wanted.
    guides : list of slice
        Which are those of the denoiser's guides; empty where they are not wanted.

    Raises
    ------
    ValueError
        The integrator refuses a parameter, the scene or the film.
    """

    def __init__(self, subject: Subject, plan: Plan) -> None:
        self.subject = subject
        self.plan = subject.planned(plan)
        wanted = subject.images(self.plan)
        self._integrator = _integrator(
            {
                **self.plan.integrator,
                **subject.parameters,
                "aovs": asking_for(wanted),
            }
        )
        self.size, first = _film_of(subject.sensor)
        self.lit = subject.lit
        names = self._integrator.aov_names()
        places = {
            name: [first + i for i, full in enumerate(names) if full.rpartition(".")[0] == name]
            for name in wanted
        }
        named = {kind: name for name, kind in wanted.items()}
        own = (0, 1, 2) if first >= 3 else (0, 0, 0)
        mixed = [places[named[kind]] for kind in MIXED] if self.plan.mixes else []
        guides = [named[kind] for kind in GUIDES] if subject.guides else []
        slices: dict[str, slice] = {}
        extra: list[int] = []
        for name in dict.fromkeys((*subject.aovs, *guides)):
            slices[name] = slice(len(extra), len(extra) + len(places[name]))
            extra += places[name]
        self.images = {name: slices[name] for name in subject.aovs}
        self.guides = [slices[name] for name in guides]
        self.layout = Layout(
            first + len(names), (*((r, g, b) for r, g, b in mixed), own), tuple(extra)
        )
        self._preview: Preview | None = None
        if subject.previewed is not None and self.plan.mixes:
            self._preview = Preview(Steering(self.layout, self.size, subject.previewed))
            self._integrator.keep_rounds()

    def preview(self) -> Preview | None:
        """A new preview of a still of these frames; None where there is nothing to choose from."""
        return None if self._preview is None else self._preview.another()

    def estimated(self) -> Estimated:
        """What the last frame has left to choose from, where there is a preview; given once."""
        frame = self._integrator.frame
        # Most of what a frame leaves: kept, it would count at the next frame's peak.
        rounds, frame.rounds = frame.rounds, []
        return Estimated(frame.history.hits, rounds)

    def restart(self, seed: int) -> None:
        """From the first frame on, with nothing learnt, and by another seed."""
        self.subject = replace(self.subject, seed=seed)
        self._integrator.reset()

    def render(self) -> mi.Float:
        """The next frame's film, its channels interleaved."""
        return self._film(self.plan.spp)

    def luminances(self, spp: int) -> npt.NDArray[np.float64]:
        """Luminances of the next frame's estimates, (K, H, W), with so many trees a pixel."""
        layout, (height, width) = self.layout, self.size
        film = np.array(self._film(spp), dtype=np.float64).reshape(height, width, layout.channels)
        self.estimated()  # lets go of it
        return np.stack([channels_luminance(film[..., list(place)]) for place in layout.estimates])

    def _film(self, spp: int) -> mi.Float:
        subject = self.subject
        return self._integrator.render(
            subject.scene, subject.sensor, seed=subject.seed, spp=spp
        ).array

    def state(self) -> State:
        """What later frames depend on."""
        return self._integrator.state()

    def take_up(self, arrays: Mapping[str, Any]) -> None:
        """
        Go on from a packed state.

        Raises
        ------
        ValueError
            It is not one of such frames.
        """
        self._integrator.prepare(self.subject.scene, self.subject.sensor)
        self._integrator.take_up(unpacked(arrays, self._integrator.state().learnt))


def _integrator(parameters: Mapping[str, Value]) -> Any:
    try:
        return mi.load_dict({"type": "restir_pt", **parameters})
    except (RuntimeError, ValueError, TypeError) as error:
        raise ValueError(one_line(error)) from error


def _film_of(sensor: mi.Sensor) -> tuple[Size, int]:
    """Its size, and how many channels it has before the auxiliary ones."""
    with frame_alone():
        film = sensor.film()
        width, height = film.crop_size()
        film.prepare([])
        count = int(film.develop().shape[2])
    if count < 3 and "mono" not in mi.variant():
        raise ValueError("the film has no colour: give it pixel_format 'rgb'")
    return (int(height), int(width)), count
