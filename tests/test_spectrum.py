"""Responses of the sensor: Mitsuba's own, as data that can be recorded."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from support import references
from support.modes import MODES
from support.runs import integrator

from mitsuba_restir.paths.spectrum import response, sensitivity, spectra_of


def test_the_response_is_mitsuba_s(spectral: str) -> None:
    scene = references.CASES["room"].load()
    rng = np.random.default_rng(1)
    # Nodes, the ends, and what is seen by nobody.
    waves = np.concatenate([rng.uniform(300.0, 900.0, 1000), [360.0, 365.0, 825.0, 830.0, 500.0]])
    lambdas = mi.Spectrum(*(mi.Float(rng.permutation(waves)) for _ in range(4)))
    value = mi.Spectrum(*(mi.Float(rng.exponential(1.0, waves.size)) for _ in range(4)))
    spectra = spectra_of(scene.sensors()[0], sensitivity())
    ours = np.array(response(spectra, value, lambdas))
    theirs = np.array(mi.spectrum_to_srgb(value, lambdas))
    np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-5)


def test_frames_are_recorded(spectral: str) -> None:
    scene = references.CASES["room"].load()
    renderer = integrator(4, MODES["both"])
    for seed in range(3):
        renderer.render(scene, seed=seed, spp=1)
    recordings = [stage._recorded.n_recordings for stage in renderer._stages.all]
    assert np.max(recordings) == 1, recordings
    assert all(stage._recordable for stage in renderer._stages.all)


@pytest.mark.parametrize("variant", ["rgb", "mono"])
def test_without_wavelengths_there_is_none(request: pytest.FixtureRequest, variant: str) -> None:
    request.getfixturevalue(variant)
    assert sensitivity() is None
    color = response(None, mi.Spectrum(0.5), dr.zeros(mi.Color0f))
    assert np.array(color).ravel() == pytest.approx(0.5)
