"""What the viewer renders: views, sides in step, stills at rest, any sensor."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir import scenes
from mitsuba_restir.analysis.denoise import installed
from mitsuba_restir.still.preview import Preview
from mitsuba_restir.viewer import camera, views
from mitsuba_restir.viewer.director import SETTLED, Director
from mitsuba_restir.viewer.exchange import Task
from mitsuba_restir.viewer.model import Settings, Side
from mitsuba_restir.viewer.reference import Reference, relmse
from mitsuba_restir.viewer.renderer import Renderer
from mitsuba_restir.viewer.resting import SHOWN_FROM
from mitsuba_restir.viewer.stream import packed
from mitsuba_restir.viewer.views import VIEWS, moved, nice

SIZE = (32, 18)


def _renderer(sensor: dict[str, Any] | None = None) -> Renderer:
    scene = scenes.load("cornell", *SIZE)
    return Renderer(
        scene, mi.load_dict(sensor) if sensor else scene.sensors()[0], 0, lambda _: None
    )


def _task(renderer: Renderer, settings: Settings, **changes: Any) -> Task:
    task = Task(settings, renderer.home, 0, 0, 0, rest=0.0, moving=False)
    return replace(task, **changes)


def _director(renderer: Renderer) -> Director:
    # Every look at the clock is a second later, so that nothing is left out for being too soon.
    seconds = iter(range(10**6))
    return Director(renderer, None, lambda _: None, lambda: float(next(seconds)))


@pytest.mark.parametrize("view", [name for name in VIEWS if name != "error"])
def test_every_view_shows_something(rgb, view):
    if view == "denoised" and not installed():
        pytest.skip("denoising needs mitsuba-oidn")
    renderer = _renderer()
    parameters = {"mutations": 1, "guiding": True}
    settings = Settings((Side(parameters, view=view), Side()))
    director = _director(renderer)
    director.picture(_task(renderer, settings))
    pose = camera.orbit(renderer.home, 0.05, 0.02)
    published = director.picture(_task(renderer, settings, pose=pose))
    (picture,) = published.pictures
    assert picture.shape == (SIZE[1], SIZE[0], 3)
    assert picture.std() > 1
    assert published.parts[0][:2] == b"\xff\xd8"


@pytest.mark.parametrize(
    ("view", "parameters"),
    [
        ("acceptance", {}),
        ("acceptance", {"mutations": 1, "mutation_interval": 2}),
        ("guide", {}),
        ("error", {}),
    ],
)
def test_a_view_of_what_is_not_there_says_why(rgb, view, parameters):
    renderer = _renderer()
    settings = Settings((Side(parameters, view=view), Side()))
    with pytest.raises(ValueError, match=VIEWS[view].title.split()[0]):
        _director(renderer).picture(_task(renderer, settings))


def test_auxiliary_images_are_those_of_the_integrator(rgb):
    renderer = _renderer()
    shot = renderer.shoot(Side(view="depth"), renderer.home, SIZE, timed=False)
    own = mi.load_dict({"type": "restir_pt", "aovs": "depth"})
    depth = np.array(own.render(renderer.scene, renderer.sensor, seed=0, spp=1))[..., 3]
    assert np.corrcoef(shot.auxiliary("depth").ravel(), depth.ravel())[0, 1] > 0.999


def test_motion_is_where_surfaces_were(rgb):
    """Against the integrator's own auxiliary image, which knows each pixel's place on the film."""
    renderer = _renderer()
    side = Side(view="motion")
    poses = (renderer.home, camera.orbit(renderer.home, 0.05, 0.0))
    shot = [renderer.shoot(side, pose, SIZE, timed=False) for pose in poses][-1]
    flow = moved(replace(shot, before=poses[0]))
    own = mi.load_dict({"type": "restir_pt", "aovs": "motion"})
    for pose in poses:
        renderer.place(pose, SIZE)
        image = np.array(own.render(renderer.scene, renderer.sensor, seed=0, spp=1))
    hit = shot.auxiliary("depth")[..., 0] > 0
    assert flow[hit] == pytest.approx(image[..., 3:][hit], abs=0.02)
    assert np.abs(flow[hit]).max() > 1


def test_sides_are_frames_of_one_sequence(rgb):
    """Two sides that differ in a value that is the default anyway show the same, frame by frame."""
    renderer = _renderer()
    a, b = Side(), Side({"spatial_feedback": 16})
    director = _director(renderer)
    for _ in range(3):
        director.picture(_task(renderer, Settings((a, b))))
    for moving in (False, True, True, False):
        pictures = director.picture(_task(renderer, Settings((a, b), True), moving=moving)).pictures
        assert (pictures[0] == pictures[1]).all()
    without = Settings((a, Side({"temporal": False})), True)
    other = [director.picture(_task(renderer, without)).pictures for _ in range(2)][-1]
    assert not (other[0] == other[1]).all()


def test_a_frozen_frame_is_shown_in_other_ways(rgb):
    renderer = _renderer()
    director = _director(renderer)
    settings = Settings(frozen=True)
    first = director.picture(_task(renderer, settings))
    assert director.done
    again = director.picture(_task(renderer, replace(settings, exposure=-2.0)))
    assert again.facts["frames"] == first.facts["frames"]
    assert again.pictures[0].mean() < first.pictures[0].mean()
    albedo = settings.with_side(0, Side(view="albedo"))
    assert director.picture(_task(renderer, albedo)).pictures[0].std() > 1
    stepped = director.picture(_task(renderer, settings, steps=1))
    assert stepped.facts["frames"] == first.facts["frames"] + 1


def test_a_resting_camera_makes_a_still_and_that_a_reference(rgb):
    renderer = _renderer()
    director = _director(renderer)
    settings = Settings()
    director.picture(_task(renderer, settings))
    resting = _task(renderer, settings, rest=2 * SETTLED)
    stills = [director.picture(resting) for _ in range(SHOWN_FROM + 8)]
    shown = [still for still in stills if still is not None]
    assert stills[: SHOWN_FROM - 1] == [None] * (SHOWN_FROM - 1)
    assert shown[-1].facts["frames"] == SHOWN_FROM + 8
    error = replace(resting, settings=settings.with_side(0, Side(view="error")), kept=1)
    facts = director.picture(error).facts
    assert facts["reference"] == f"{SHOWN_FROM + 8} frames"
    assert facts["relmse"][0] < 0.05
    (spectrum,) = director.plots.spectra
    assert all(power >= 0 for _, power in spectrum)
    # Another view has no reference.
    away = replace(error, pose=camera.dolly(renderer.home, 0.1), rest=0.0)
    with pytest.raises(ValueError, match="no reference"):
        director.picture(away)
    # And none is made of the still that it left.
    with pytest.raises(ValueError, match="no reference"):
        director.picture(replace(away, kept=2))


def test_with_selection_a_still_is_steered_and_its_reference_plain(rgb):
    renderer = _renderer()
    director = _director(renderer)
    settings = Settings((Side({"blue_noise": "selection"}), Side()))
    resting = _task(renderer, settings, rest=2 * SETTLED)
    shown = [director.picture(resting) for _ in range(SHOWN_FROM)][-1]
    assert shown is not None
    plain = director._resting.still(denoise=False).image
    steered = director._resting.shown()
    assert (steered != plain).any()
    np.testing.assert_allclose(steered.mean(), plain.mean(), rtol=1e-5)
    director.picture(replace(resting, kept=1))
    reference = director._reference.image
    np.testing.assert_array_equal(reference, plain)
    assert director._resting.still(denoise=False).frames == SHOWN_FROM + 1


def test_what_is_measured_of_a_still_is_its_mean_and_steered_is_what_is_seen(rgb, monkeypatch):
    steered = []
    add = Preview.add
    monkeypatch.setattr(Preview, "add", lambda self, *args: (steered.append(1), add(self, *args)))
    renderer = _renderer()
    truth = np.random.default_rng(0).random((SIZE[1], SIZE[0], 3), dtype=np.float32)
    reference = Reference(truth, renderer.home, "a file")
    seconds = iter(range(10**6))
    director = Director(renderer, reference, lambda _: None, lambda: float(next(seconds)))
    settings = Settings((Side({"blue_noise": "selection"}), Side()))
    resting = _task(renderer, settings, rest=2 * SETTLED)
    facts = [director.picture(resting) for _ in range(SHOWN_FROM)][-1].facts
    plain, shown = director._resting.still(denoise=False).image, director._resting.shown()
    assert facts["relmse"] == [relmse(plain, reference)]
    assert facts["relmse"] != [relmse(shown, reference)]
    assert len(steered) == SHOWN_FROM
    seen = replace(
        resting, settings=settings.with_side(0, replace(settings.sides[0], view="error"))
    )
    (picture,) = director.picture(seen).pictures
    plain = director._resting.still(denoise=False).image
    np.testing.assert_array_equal(picture, views.error(plain, reference).picture)
    assert len(steered) == SHOWN_FROM
    director.picture(resting)
    assert len(steered) == SHOWN_FROM + 1


def test_a_black_still_is_said_in_json(rgb):
    renderer = _renderer()
    director = _director(renderer)
    # Behind the back wall, which is black from there.
    away = replace(renderer.home, origin=(0.0, 0.95, -9.0), target=(0.0, 0.95, -1.2))
    resting = _task(renderer, Settings(), pose=away, rest=2 * SETTLED)
    shown = [director.picture(resting) for _ in range(SHOWN_FROM)][-1]
    assert shown.facts["error"] is None
    assert b"Infinity" not in packed(shown)


def test_a_frozen_still_stays(rgb):
    renderer = _renderer()
    director = _director(renderer)
    resting = _task(renderer, Settings(), rest=2 * SETTLED)
    director.picture(_task(renderer, Settings()))
    still = [director.picture(resting) for _ in range(SHOWN_FROM)][-1]
    frozen = director.picture(replace(resting, settings=Settings(frozen=True)))
    assert frozen.facts["state"] == "frozen"
    assert (frozen.pictures[0] == still.pictures[0]).all()
    assert director.done
    assert director.picture(resting).facts["frames"] == SHOWN_FROM + 1


def test_fewer_pixels_while_it_moves_and_all_at_rest(rgb):
    renderer = _renderer()
    director = _director(renderer)
    settings = Settings(fps=1e5)
    for _ in range(8):
        director.picture(_task(renderer, settings))
    moving = director.picture(_task(renderer, settings, moving=True)).facts
    assert moving["width"] < SIZE[0]
    assert director.picture(_task(renderer, settings)).facts["width"] == SIZE[0]


def test_what_the_integrator_refuses_is_a_line(rgb):
    renderer = _renderer()
    side = Side({"mutation_acceptance": "energy"})
    with pytest.raises(ValueError, match="mutations of at least 1"):
        _director(renderer).picture(_task(renderer, Settings((side, side))))


def test_few_histories_are_kept(rgb):
    renderer = _renderer()
    for neighbors in range(1, 9):
        renderer.shoot(Side({"spatial_neighbors": neighbors}), renderer.home, SIZE, timed=False)
    assert 1 < len(renderer._integrators) <= 4


@pytest.mark.parametrize(
    "kind",
    [
        {"type": "thinlens", "aperture_radius": 0.05, "focus_distance": 4.0, "fov": 43.6},
        {"type": "orthographic"},
    ],
)
@pytest.mark.filterwarnings("ignore:restir_pt. Ortho")
def test_other_sensors_are_moved_too(rgb, kind):
    look = mi.ScalarTransform4f().look_at([0, 0.95, 4.9], [0, 0.95, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": 64, "height": 36, "rfilter": {"type": "box"}}
    film |= {"crop_width": 32, "crop_height": 18, "crop_offset_x": 16, "crop_offset_y": 8}
    renderer = _renderer({**kind, "to_world": look, "film": film})
    assert renderer.full == (32, 18)
    near = renderer.shoot(Side(), camera.look(renderer.home, 0.1, 0.0), (16, 9), timed=False)
    assert near.image.shape == (9, 16, 3)
    back = renderer.shoot(Side(), renderer.home, renderer.full, timed=True)
    assert back.image.shape == (18, 32, 3)
    assert list(renderer.sensor.film().size()) == [64, 36]
    assert sum(back.passes.values()) > 0
    assert dr.allclose(renderer.sensor.film().crop_offset(), [16, 8])


def test_nice_scales():
    assert [nice(x) for x in (0.0, 1.0, 1.1, 3.0, 7.0, 0.03)] == [1, 1, 2, 5, 10, 0.05]
