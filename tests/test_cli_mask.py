"""`mitsuba-restir mask`: all files are written and agree; wrong use is one line."""

import csv
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir import cli
from mitsuba_restir.sampling import masks


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(masks, "cache_folder", lambda: tmp_path / "cache")
    return tmp_path


def spectrum(stem):
    with Path(f"{stem}-spectrum.csv").open() as file:
        return np.array([[float(value) for value in row] for row in list(csv.reader(file))[1:]])


def test_a_mask_and_its_spectrum_are_written(folder, capsys):
    assert cli.main(["mask", "-o", "new/masks", "--size", "32", "--seed", "7"]) == 0
    stem = "new/masks/void_and_cluster-32"
    suffixes = ("-figure.png", "-spectrum.csv", "-spectrum.png", ".exr", ".npy", ".png")
    assert sorted(map(str, Path("new/masks").iterdir())) == [stem + end for end in suffixes]
    assert f"{stem}-figure.png" in capsys.readouterr().out
    ranks = np.load(f"{stem}.npy")
    np.testing.assert_array_equal(ranks, masks.void_and_cluster(32, 7))
    values = np.array(mi.Bitmap(f"{stem}.exr"))
    np.testing.assert_allclose(values.reshape(32, 32), masks.mask_values(ranks), rtol=1e-6)
    grey = np.array(mi.Bitmap(f"{stem}.png")).reshape(32, 32)
    np.testing.assert_array_equal(grey, ranks // 4)
    frequency, power, _ = spectrum(stem).T
    assert power[frequency < 0.125].max() < 0.02
    assert power[frequency > 0.4].min() > 1.0
    # Frequency 0 is in the centre, and the power rises outwards from it.
    picture = np.array(mi.Bitmap(f"{stem}-spectrum.png")).reshape(32, 32)
    assert picture[16, 16] == 0
    assert picture[0].mean() > 150 > 20 > picture[15:18, 15:18].max()


def test_the_figure_shows_white_noise_beside_the_mask(folder):
    for kind, panels in (("white", 2), ("void_and_cluster", 4)):
        assert cli.main(["mask", "-o", ".", "--size", "16", "--kind", kind]) == 0
        height, width, channels = np.array(mi.Bitmap(f"{kind}-16-figure.png")).shape
        assert channels == 3
        assert width // height == panels - 1  # square panels with labels above
    _, power, _ = spectrum("white-16").T
    assert power.mean() == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--kind", "pink"], "annealing"),
        (["--size", "8"], "from 14"),
        (["--size", "100000"], "4096"),
        (["--seed", "-1"], "from 0"),
        (["-o", "file/folder"], "cannot write"),
    ],
)
def test_wrong_use_is_one_line(folder, capsys, arguments, word):
    Path("file").touch()
    assert cli.main(["mask", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert word in error
    assert [path.name for path in folder.iterdir()] == ["file"]
