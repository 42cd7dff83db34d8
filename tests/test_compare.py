"""The comparison: its numbers, its files, and its use of references."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from mitsuba_restir import cli, imageio
from mitsuba_restir.cli import compare, compare_time
from mitsuba_restir.cli.compare_report import Errors, Row, strip
from mitsuba_restir.cli.compare_time import Shown
from mitsuba_restir.studies import load_study
from mitsuba_restir.studies.config.adapt import without
from mitsuba_restir.studies.runs.results import ReferenceImage

IMAGE = np.full((6, 8, 3), 0.5, dtype=np.float32)


def row(label, milliseconds, frame, mean):
    return Row(label, milliseconds, Errors(frame, frame / 2), Errors(mean, mean), 10, IMAGE, IMAGE)


def test_gain_is_time_that_path_needs_for_the_same_error():
    path = row("path", 20.0, 8.0, 0.8)
    other = row("other", 40.0, 1.0, 0.1)
    np.testing.assert_allclose(path.gains(path, trimmed=False), (1.0, 0.1, 1.0))
    np.testing.assert_allclose(other.gains(path, trimmed=False), (4.0, 0.4, 4.0))
    assert other.gains(path, trimmed=True)[0] == 4.0


def test_an_error_of_nothing_makes_no_gain():
    path, other = row("path", 20.0, 8.0, 0.8), row("other", 40.0, 1.0, -0.1)
    numbers = other.numbers(path)
    assert numbers["gain_mean_of_frames"] is None
    assert numbers["gain_last_frame"] == 4.0
    assert numbers["relmse_mean_of_frames"] == -0.1


def test_strip_holds_every_picture():
    rows = [row("a", 1, 1, 1), row("b", 1, 1, 1)]
    picture = strip("title", rows, IMAGE)
    assert picture.dtype == np.uint8
    # 0.5 is 187.5 in 8-bit sRGB, and Mitsuba dithers.
    grey = np.all((picture >= 187) & (picture <= 188), axis=2)
    assert np.sum(grey) >= 6 * IMAGE[..., 0].size


def test_labels_of_equal_time_are_inside_their_columns():
    shown = [Shown("still --denoise, 100 frames of a long name", 10.0, IMAGE)] * 6
    picture = compare_time.strip("title", shown, ReferenceImage(IMAGE, np.zeros(IMAGE.shape)))
    column = (picture.shape[1] - 8) // 3
    for edge in range(column, 3 * column + 1, column):
        assert (picture[30:, edge : edge + 8] == 255).all()


def test_srgb_of_nothing_finite_is_black():
    image = np.array([[[np.nan, np.inf, 1.0]]])
    np.testing.assert_array_equal(imageio.to_srgb8(image), [[[0, 0, 255]]])


@pytest.mark.slow
def test_comparison_writes_pictures_and_numbers(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    size = ["ajar", "--resolution", "32x18", "-p", "max_depth=3"]
    reference = ["compare", *size, "--make-reference", "r.exr", "--reference-spp", "40"]
    assert cli.main(reference) == 0
    assert imageio.read_rgb(Path("r.exr")).shape == (18, 32, 3)
    timed = ["--frames", "3", "--equal-time", "0.4", "-o", "o"]
    assert cli.main(["compare", *size, "--reference", "r.exr", *timed]) == 0
    assert "spatiotemporal" in capsys.readouterr().out
    variants = json.loads(Path("o/compare.json").read_text())["variants"]
    labels = [variant["variant"] for variant in variants]
    assert labels == ["path", "candidates", "spatial", "spatiotemporal"]
    assert variants[0]["gain_last_frame"] == 1.0
    assert all(np.isfinite(value) for entry in variants for value in list(entry.values())[1:])
    assert Path("o/compare.csv").read_text().count("\n") == 5
    assert Path("o/compare.png").stat().st_size > 0
    _, *pictures = csv.reader(Path("o/equal_time.csv").read_text().splitlines())
    assert [re.split(r"\W", name)[0] for name, *_ in pictures] == ["path", "frame", "still"] * 2
    for _, seconds, error in pictures:
        # The first frame is rendered however long it takes.
        assert 0 < float(seconds) < 6
        assert 0 < float(error)
    assert Path("o/equal_time.png").stat().st_size > 0
    np.testing.assert_array_equal(
        imageio.read_rgb(Path("o/reference.exr")), imageio.read_rgb(Path("r.exr"))
    )
    capsys.readouterr()
    wrong = ["compare", "ajar", "--resolution", "16x16", "--reference", "r.exr", "-o", "p"]
    assert cli.main(wrong) == 2
    assert "32x18" in capsys.readouterr().err
    assert not Path("p").exists()


@pytest.mark.slow
def test_the_noise_of_the_reference_is_subtracted_and_named(tmp_path, monkeypatch, capsys):
    """With few samples, path's own mean must not look worse than it is."""
    monkeypatch.chdir(tmp_path)
    size = ["compare", "cornell", "--resolution", "32x18", "-p", "max_depth=3", "--frames", "128"]
    others = ["candidates", "spatial", "spatiotemporal"]
    monkeypatch.setattr(compare, "load_study", lambda name: without(load_study(name), others))
    errors = {}
    for spp in (64, 2048):
        found = []
        # One run says little: a few pixels have most of the error.
        for seed in range(3):
            words = ["--reference-spp", str(spp), "--seed", str(seed), "-o", "o"]
            assert cli.main([*size, *words]) == 0
            variants = json.loads(Path("o/compare.json").read_text())["variants"]
            found.append(variants[0]["relmse_mean_of_frames"])
            noisy = "do not rely on relMSE of mean" in capsys.readouterr().err
            assert noisy == (spp == 64)
        errors[spp] = np.median(found)
    assert errors[64] == pytest.approx(errors[2048], rel=0.35)


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["llvm_ad_mono", "llvm_ad_spectral"])
def test_every_variant_can_be_compared(variant, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["compare", "cornell", "--resolution", "16x12", "--frames", "2", "-m", variant]
    assert cli.main([*words, "--reference-spp", "8", "-o", "o"]) == 0
    assert imageio.read_rgb(Path("o/path_mean.exr")).shape == (12, 16, 3)
    assert imageio.read_rgb(Path("o/reference.exr")).shape == (12, 16, 3)


@pytest.mark.slow
def test_ctrl_c_ends_a_comparison_in_one_line(tmp_path, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(compare, "render_run", interrupted)
    words = ["compare", "cornell", "--resolution", "16x12", "--reference-spp", "8"]
    assert cli.main([*words, "-o", str(tmp_path / "o")]) == cli.INTERRUPTED
    assert capsys.readouterr().err.splitlines()[-1] == "mitsuba-restir: interrupted"


@pytest.mark.slow
def test_ctrl_c_at_equal_time_keeps_the_comparison(tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(compare.compare_time, "pictures", interrupted)
    words = ["compare", "cornell", "--resolution", "16x12", "--reference-spp", "8"]
    words += ["--frames", "2", "--equal-time", "9", "-o", str(tmp_path)]
    assert cli.main(words) == cli.INTERRUPTED
    assert (tmp_path / "compare.csv").stat().st_size > 0
    assert not (tmp_path / "equal_time.csv").exists()
