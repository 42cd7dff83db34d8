"""The report: its parts, its numbers, and the page in a real browser."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow
from PIL import ImageFont
from scipy import ndimage

import mitsuba_restir.studies.runner as runner
import mitsuba_restir.studies.store.reference as reference_module
from mitsuba_restir import cache
from mitsuba_restir.analysis.colours import diverging, sequential
from mitsuba_restir.analysis.covariance_images import lag_products
from mitsuba_restir.analysis.images import luminance
from mitsuba_restir.analysis.intervals import Interval
from mitsuba_restir.errors import UsageError
from mitsuba_restir.studies import Study, load_study, run
from mitsuba_restir.studies.measure.biases import block_scores
from mitsuba_restir.studies.measure.frame_errors import chain_spectra
from mitsuba_restir.studies.measure.results import Measured, Row
from mitsuba_restir.studies.notebook import Results
from mitsuba_restir.studies.report import curves, figures
from mitsuba_restir.studies.report.headline import headline, percent, short
from mitsuba_restir.studies.report.page import _smallest_png
from mitsuba_restir.studies.report.pictures import galleries, shown_of
from mitsuba_restir.studies.report.spectra import mask_pictures, mutation_pictures
from mitsuba_restir.studies.report.strips import CROP, crop_of, strip, wrapped
from mitsuba_restir.studies.runs.rendering import Renderer
from mitsuba_restir.studies.runs.results import ReferenceImage, Run

STUDY = """
name = "drawn"
about = "First.\\n\\nThen <b>more</b>."
scene = "ajar"
sizes = ["64x40"]
frames = 3
runs = 6
keep = "all"
seed = 5
quantities = ["rmse", "relmse_trimmed", "covariance", "equal_time", "time",
    "rmse_relative", "smape"]

[published.better]
RMSE = 0.125

[reference]
spp = 640
batches = 4

[variants.plain]
type = "path"

[variants.better]
type = "path"
spp = 4
"""


def _renderer(study: Study, scene: Any, size: tuple[int, int], name: str, variant: Any) -> Renderer:
    class Fake(Renderer):
        def frame(self, seed: int) -> tuple[Any, float]:
            rng = np.random.default_rng(seed)
            truth = np.linspace(0.1, 1.5, size[0])[None, :, None]
            spread = 0.5 / np.sqrt(variant.spp)
            noise = rng.lognormal(-(spread**2) / 2, spread, (size[1], size[0], 3))
            return (truth * noise).astype(np.float32), 0.01 * variant.spp

    return Fake(lambda seed: None, lambda: None, False)


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Results:
    pytest.importorskip("matplotlib")
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(runner, "load_scene", lambda study: None)
    monkeypatch.setattr(runner, "make_renderer", _renderer)
    monkeypatch.setattr(reference_module, "make_renderer", _renderer)
    file = tmp_path / "drawn.toml"
    file.write_text(STUDY)
    return run(load_study(str(file)), tmp_path / "out")


def _row(variant: str, value: float, ratio: Interval | None) -> Row:
    return Row("8x8", variant, "RMSE", "", Interval(value, 0.9 * value, 1.1 * value, 0.0), ratio, 4)


def test_the_headline_says_what_is_sure() -> None:
    rows = [
        _row("a", 1.0, None),
        _row("b", 0.8, Interval(0.8, 0.7, 0.9, 0.0)),
        _row("c", 1.1, Interval(1.1, 0.9, 1.3, 0.0)),
        _row("d", 1.5, Interval(1.5, 1.3, 1.7, 0.0)),
    ]
    table = headline(rows, "8x8", {"b": {"RMSE": 0.75}})
    assert table.headings == ["RMSE"]
    cells = {name: cells[0] for name, cells in table.lines.items()}
    assert [cell.verdict for cell in cells.values() if cell] == ["", "better", "", "worse"]
    assert cells["b"] is not None
    assert cells["b"].ratio == "-20.0 % (-30.0 … -10.0)"
    assert cells["b"].published == "0.75"


def test_the_headline_colours_nothing_that_its_p_value_does_not() -> None:
    ratio = Interval(0.8, 0.7, 0.9, 0.0)
    rows = [replace(_row(name, 0.8, ratio), p_value=p) for name, p in (("a", 0.125), ("b", 0.03))]
    cells = [cells[0] for cells in headline(rows, "8x8", {}).lines.values()]
    assert [cell.verdict for cell in cells if cell] == ["", "better"]


def test_numbers_are_written_as_short_as_they_can_be() -> None:
    assert [short(x) for x in (0.0123456, 1234.5, 2.0, 3.5208e-5, 1.5e7)] == [
        "0.0123", "1234", "2", "3.52e-5", "1.5e7",
    ]  # fmt: skip
    assert percent(Interval(0.8, 0.5, 1.2, 0.1)) == "-20 % (-50 … +20)"
    assert percent(Interval(6.81, 4.91, 9.43, 1.0)) == "× 6.81 (4.91 … 9.43)"
    # Ratios of covariances whose sign is not known.
    for low, high in ((-114.0, 339.0), (0.01, 148.0)):
        assert percent(Interval(-37.0, low, high, 9.0)) == "not resolved"


def test_maps_have_the_colours_they_say() -> None:
    colours = diverging(np.array([[-1.0, 0.0, 1.0, np.nan]]))[0]
    assert colours[0][2] > colours[0][0]
    np.testing.assert_array_equal(colours[1], [255, 255, 255])
    assert colours[2][0] > colours[2][2]
    brightness = sequential(np.linspace(0.0, 1.0, 9)[None])[0].astype(int).sum(axis=1)
    assert np.all(np.diff(brightness) > 0)


@pytest.mark.parametrize(
    "label", ["path", "path_without_light_sampling", "a" * 60, "RMSE, displayed 0.0764", "_" * 50]
)
def test_labels_of_the_strip_are_broken_and_never_cut(label: str) -> None:
    font = ImageFont.load_default(13)
    lines = wrapped(label, font, 128)
    assert "".join(lines) == label
    assert max(font.getlength(line.rstrip()) for line in lines) <= 128


def test_labels_of_the_strip_stay_within_their_columns() -> None:
    names = ("path_without_light_sampling", "spatiotemporal_with_energy_updated")
    image = np.full((16, 32, 3), 0.5, dtype=np.float32)
    runs = {name: [Run(image, image, np.zeros(1))] for name in names}
    data = Measured("32x16", runs, names[0], {}, None, 0.01, 0.0)
    picture = strip(data, shown_of(data), {}, dict.fromkeys(names, "a caption that is too long"))
    # What is between the columns is white from top to bottom.
    gap = picture[:, 96 + 128 : 96 + 128 + 6]
    assert picture.shape[1] == 96 + 2 * (128 + 6)
    assert np.all(gap == 255)
    assert np.any(picture[:40, 96 : 96 + 128] != 255)


def test_a_bias_is_seen(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    truth = np.full((32, 32, 3), 0.5)
    noise = 0.05 * rng.standard_normal((8, 32, 32, 3))
    noise[:, :8, :8] += 0.05
    images = [(truth + e).astype(np.float32) for e in noise]
    runs = {"a": [Run(image, image, np.zeros(1)) for image in images]}
    reference = ReferenceImage(truth, np.zeros_like(truth))
    data = Measured("32x32", runs, "a", {}, reference, 0.01, 0.0)
    (bias,) = (gallery for gallery in galleries(data, shown_of(data)) if gallery.key == "bias")
    blocks = bias.pictures["a"][::4, ::4]
    full = diverging(np.ones((1, 1)))[0, 0]
    beyond = np.all(blocks == full, axis=2)
    assert beyond[0, 0]
    assert beyond.sum() == 1


def test_the_map_of_bias_is_as_quiet_as_it_says_with_few_runs() -> None:
    """Of Student's t with 3 degrees of freedom 14 % are beyond 2; of the map's blocks 5 %."""
    rng = np.random.default_rng(4)
    truth = np.full((256, 256, 3), 0.5)
    images = truth + 0.05 * rng.standard_normal((4, 256, 256, 1))
    runs = {"a": [Run(image, image, np.zeros(1)) for image in images.astype(np.float32)]}
    scores = block_scores(runs["a"], ReferenceImage(truth, np.zeros_like(truth)))
    assert np.mean(np.abs(scores) > 2.0) == pytest.approx(0.046, abs=0.02)
    assert np.std(scores) == pytest.approx(1.0, abs=0.1)


def lag_covariance(runs: np.ndarray, reference: np.ndarray, *, radius: int) -> np.ndarray:
    return lag_products(runs, reference, radius=radius).sum(axis=0) / (len(runs) - 1)


def _white_and_blurred() -> Measured:
    """White noise, and the same power in blotches, on a flat truth of luminance 1."""
    rng = np.random.default_rng(6)
    truth = np.ones((48, 64, 3))
    white = 0.2 * rng.standard_normal((6, 48, 64, 1))
    wide = ndimage.gaussian_filter(white, (0, 2, 2, 0), mode="wrap")
    wide *= white.std() / wide.std()
    runs = {
        name: [Run(*2 * ((truth + error).astype(np.float32),), np.ones(1)) for error in errors]
        for name, errors in (("white", white), ("blotches", wide))
    }
    baselines = dict.fromkeys(runs, "white")
    return Measured("64x48", runs, "white", baselines, ReferenceImage(truth, 0 * truth), 0.01, 0.0)


def test_covariance_by_distance_with_its_error() -> None:
    data = _white_and_blurred()
    found = curves.lag_covariances(data)
    images = np.stack([luminance(run.last) for run in data.runs["blotches"]])
    reference = np.ones((48, 64))
    np.testing.assert_allclose(
        found["blotches"].image,
        lag_covariance(images, reference, radius=curves.LAG_RADIUS),
        rtol=1e-6,
        atol=1e-9,
    )
    left_out = [
        lag_covariance(np.delete(images, k, axis=0), reference, radius=curves.LAG_RADIUS)
        for k in range(6)
    ]
    # At a distance of one pixel there are the 4 neighbours and the 4 diagonal ones.
    middle = slice(curves.LAG_RADIUS - 1, curves.LAG_RADIUS + 2)
    near = [
        (lags[middle, middle].sum() - lags[curves.LAG_RADIUS, curves.LAG_RADIUS]) / 8
        for lags in left_out
    ]
    assert found["blotches"].error[0] == pytest.approx(np.sqrt(5 * np.var(near)), rel=1e-6)
    curve = found["blotches"].covariance
    # A Gaussian of 2 pixels twice: exp(-d² / 16) of the variance.
    assert curve[0] == pytest.approx(0.04 / 1.01**2 * np.exp(-1.5 / 16), rel=0.15)
    assert curve[0] > curve[3] > curve[7]
    assert np.all(np.abs(found["white"].covariance) < 4 * found["white"].error + 1e-4)
    assert len(curves.records(found, "64x48")) == 2 * (2 * curves.LAG_RADIUS + 1) ** 2


def test_power_against_the_baseline() -> None:
    data = _white_and_blurred()
    assert data.reference is not None
    found = curves.radial_powers(data, chain_spectra(data, data.reference))
    assert found["white"].ratio is None
    ratio = found["blotches"].ratio
    assert ratio is not None
    np.testing.assert_allclose(ratio[0], found["blotches"].power / found["white"].power)
    f = found["white"].frequency
    assert ratio[0][f < 0.06].min() > 3.0
    assert ratio[0][f > 0.3].max() < 0.1
    lines = curves.records(found, "64x48")
    assert len(lines) == 2 * len(f)
    assert lines[0]["ratio"] == ""


def test_the_spectrum_is_drawn_with_its_error() -> None:
    pytest.importorskip("matplotlib")
    power = np.array([4.0, 2.0, 1.0])
    curve = curves.Radial(np.array([0.1, 0.2, 0.4]), power, np.array([0.4, 0.2, 2.0]), None)
    (band,) = figures.radial({"a": curve}, {"a": "#000000"}).axes[0].collections
    ends = band.get_paths()[0].vertices
    for x, low, high in ((0.1, 3.6, 4.4), (0.2, 1.8, 2.2), (0.4, 0.05, 3.0)):
        drawn = ends[ends[:, 0] == x, 1]
        assert (drawn.min(), drawn.max()) == pytest.approx((low, high))


@pytest.mark.parametrize(
    ("values", "scale"),
    [((1.0, 3.0), "linear"), ((0.1, 30.0), "log"), ((-0.1, 30.0), "linear")],
)
def test_far_apart_values_are_drawn_by_decades(values: tuple[float, ...], scale: str) -> None:
    pytest.importorskip("matplotlib")
    rows = [
        Row("64x40", name, "RMSE", "", Interval(value, value - 0.2, value + 0.2, 0.1), None, 6)
        for name, value in zip("ab", values, strict=True)
    ]
    axes = figures.quantity(rows, "RMSE").axes[0]
    assert axes.get_xscale() == scale
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "b"]
    assert axes.yaxis_inverted()


def test_crops_are_where_there_is_something_to_see() -> None:
    y = np.linspace(0.4, 1.0, 200)[None, :] * np.ones((120, 1))
    i, j = np.mgrid[40:80, 80:120]
    y[40:80, 80:120] *= np.where((i // 8 + j // 8) % 2, 1.25, 0.8)
    rows, columns = crop_of(y, smooth=False)
    assert (rows.stop - rows.start, columns.stop - columns.start) == (CROP, CROP)
    assert rows.start < 80
    assert rows.stop > 40
    assert columns.start < 120
    assert columns.stop > 80
    assert y[crop_of(y, smooth=True)].std() < 0.3 * y[rows, columns].std()
    assert crop_of(np.ones((9, 30)), smooth=True) == (slice(0, 9), slice(0, 9))


def test_masks_and_mutations_are_drawn_where_they_are_used(tmp_path: Path) -> None:
    file = tmp_path / "drawn.toml"
    file.write_text(STUDY)
    study = load_study(str(file))
    data = _white_and_blurred()
    shown = shown_of(data)
    assert not mask_pictures(study).pictures
    assert not mutation_pictures(study, data, shown).pictures
    text = STUDY.replace('"path"', '"restir_pt"', 1).replace("plain", "white")
    text = text.replace("better", "blotches")
    file.write_text(f"{text}\nmutations = 5\nblue_noise = 'mutation'\n")
    study = load_study(str(file))
    pictures = mask_pictures(study).pictures
    assert list(pictures) == [
        "white mask", "white mask, spectrum", "blue mask", "blue mask, spectrum",
    ]  # fmt: skip
    blue, white = (pictures[f"{kind} mask, spectrum"].astype(int) for kind in ("blue", "white"))
    middle = slice(118, 138)
    assert blue[middle, middle].mean() < 0.5 * white[middle, middle].mean()
    drawn = mutation_pictures(study, data, shown).pictures
    assert list(drawn) == ["white", "blotches"]
    assert drawn["white"].shape == (4 * 48, 2 * 4 * 48 + 4, 3)


def test_maps_are_stored_with_a_palette() -> None:
    picture = diverging(np.linspace(-1.0, 1.0, 900).reshape(30, 30))
    data = _smallest_png(picture)
    with Pillow.open(io.BytesIO(data)) as image:
        assert image.mode == "P"
        np.testing.assert_array_equal(np.array(image.convert("RGB")), picture)
    noisy = np.random.default_rng(1).integers(0, 256, (30, 30, 3)).astype(np.uint8)
    with Pillow.open(io.BytesIO(_smallest_png(noisy))) as image:
        np.testing.assert_array_equal(np.array(image.convert("RGB")), noisy)


def test_the_report_is_one_file(results: Results) -> None:
    page = results.report()
    text = page.read_text("utf-8")
    # Nothing is fetched from anywhere: every address is data or a fragment of the page.
    addresses = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert addresses
    assert all(a.startswith(("data:image/png;base64,", "#")) for a in addresses)
    assert "@import" not in text
    assert "Then &lt;b&gt;more&lt;/b&gt;." in text
    assert "published 0.125" in text
    noise = re.search(r"([\d.]+) % of a pixel.s luminance in the median", unescape(text))
    # 4 batches of 160 samples each, whose noise is log-normal of 0.5 / sqrt(160), all channels.
    assert noise is not None
    assert "A part of it stays in “relMSE, trimmed”." in unescape(text)
    floor = re.search(
        r"All of it stays in “SMAPE”: of a perfect image .* about ([\d.]+)\.", unescape(text)
    )
    assert floor is not None
    # The mean of |a - b| / (a + b) of two values whose difference is normal.
    assert float(floor[1]) == pytest.approx(0.5 / 640**0.5 * (2.0 / np.pi) ** 0.5 / 2.0, rel=0.3)
    assert "What is clipped favours images that are too dark" in text
    assert float(noise[1]) == pytest.approx(100 * 0.5 / 640**0.5, rel=0.4)
    assert "mitsuba-restir evaluate" in text
    ids = re.findall(r' id="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    figures = {f.name for f in (results.path / "figures" / "64x40").iterdir()}
    drawn = ("radial_spectrum", "radial_ratio", "covariance_by_distance", "convergence_frames")
    assert {f"{name}.{kind}" for name in drawn for kind in ("svg", "png")} <= figures
    assert {"strip.png", "lags_plain.png", "spectra_better.png", "seen_plain.png"} <= figures
    with Pillow.open(results.path / "figures" / "64x40" / "spectra_plain.png") as spectrum:
        assert spectrum.size == (64, 64)
    for name, columns in (("spectra", "cycles_per_pixel"), ("covariances", "relative_covariance")):
        assert columns in (results.path / f"{name}.csv").read_text().splitlines()[0]
    assert {f"images_{name}.png" for name in ("plain", "better", "reference")} <= figures
    frames = {f.name for f in (results.path / "frames" / "64x40").iterdir()}
    assert frames == {"plain.exr", "better.exr", "reference.exr"}
    # The same numbers make the same page, byte for byte.
    assert page.read_bytes() == results.report().read_bytes()


def test_curves_are_the_errors_of_averages(results: Results) -> None:
    results.report()
    lines = list(csv.DictReader((results.path / "curves.csv").read_text().splitlines()))
    assert len(lines) == 2 * 3
    first, last = lines[0], lines[2]
    start, end = (float(line["relmse_trimmed_of_average"]) for line in (first, last))
    assert float(first["relmse_trimmed"]) == pytest.approx(start)
    # Independent frames: three have a third of the error, and take three times as long.
    assert 0.2 < end / start < 0.5
    assert float(last["seconds"]) == pytest.approx(0.03)


def test_numbers_as_a_data_frame_and_a_figure(results: Results) -> None:
    pandas = pytest.importorskip("pandas")
    frame = results.frame()
    assert isinstance(frame, pandas.DataFrame)
    better = frame[(frame.quantity == "RMSE") & (frame.variant == "better")]
    assert better.p_value.item() <= 1.0
    assert better.ratio.item() == pytest.approx(0.5, abs=0.1)
    assert results.figure("RMSE").axes[0].get_xlabel() == "RMSE"
    with pytest.raises(UsageError, match=r"no 'HDR-FLIP' at 64x40: there are RMSE"):
        results.figure("HDR-FLIP")
    for drawn in (results.convergence(), results.convergence("seconds"), results.spectra()):
        labels = [text.get_text() for text in drawn.axes[0].get_legend().get_texts()]
        assert labels == ["plain", "better"]


def test_a_study_runs_by_name_in_a_folder_of_its_own(
    results: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    again = run(str(tmp_path / "drawn.toml"))
    assert again.path == Path("out/evaluate-drawn")
    assert again.table.records() == results.table.records()


def test_the_page_in_a_browser(results: Results, browser: Any) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    trouble: list[str] = []
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.on("console", lambda message: trouble.append(message.text))
    page.on("request", lambda request: trouble.append(request.url))
    page.goto(results.report().as_uri())
    page.wait_for_selector(".compare[data-ready]")
    trouble = [url for url in trouble if not url.startswith(("file:", "data:"))]

    rows = page.locator("table.headline tbody tr")
    assert rows.locator("th b").all_inner_texts() == ["plain", "better"]
    assert rows.nth(1).locator("th small").inner_text() == "against plain"
    heads = page.locator("table.headline thead th").all_inner_texts()
    cell = rows.nth(1).locator("td").nth(heads.index("RMSE") - 1)
    shown = float(cell.locator("b").inner_text())
    row = next(r for r in results.table.rows if r.quantity == "RMSE" and r.variant == "better")
    assert shown == pytest.approx(row.value.value, rel=5e-3)
    assert "better" in (cell.get_attribute("class") or "")

    handle, stage = page.locator(".handle"), page.locator(".stage")
    stage.scroll_into_view_if_needed()
    box, grip = stage.bounding_box(), handle.bounding_box()
    page.mouse.move(grip["x"] + grip["width"] / 2, box["y"] + 0.3 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"], steps=4)
    page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"], steps=4)
    page.mouse.up()
    assert handle.get_attribute("aria-valuenow") == "25"
    assert "75%" in page.locator(".over").evaluate("e => e.style.clipPath")
    handle.press("ArrowRight")
    assert handle.get_attribute("aria-valuenow") == "26"

    crops = page.locator(".crops canvas")
    assert crops.count() == 3
    before = crops.evaluate_all("all => all.map(c => c.dataset.crop)")
    assert len(set(before)) == 1
    page.mouse.click(box["x"] + 0.9 * box["width"], box["y"] + 0.9 * box["height"])
    page.mouse.wheel(0, -100)
    page.wait_for_function(
        "old => [...document.querySelectorAll('.crops canvas')].every(c => c.dataset.crop != old)",
        arg=before[0],
    )
    page.wait_for_function(
        "new Set([...document.querySelectorAll('.crops canvas')].map(c => c.dataset.crop)).size==1"
    )
    # The comparison shows the picture that is chosen.
    pixels = "canvas => canvas.toDataURL()"
    first = page.locator(".over").evaluate(pixels)
    page.select_option("select.left", "better")
    assert page.locator(".over").evaluate(pixels) != first
    page.select_option("select.left", "plain")
    assert page.locator(".over").evaluate(pixels) == first
    # So does it in another layer; the reference, which has no errors, stays as it is.
    reference = page.locator(".under").evaluate(pixels)
    page.select_option("select.layer", "errors")
    assert page.locator(".over").evaluate(pixels) != first
    assert page.locator(".under").evaluate(pixels) == reference

    # The anchors lead somewhere, and the search leaves what is looked for.
    for link in page.locator("nav a").all():
        assert page.locator(f"[id='{link.get_attribute('href')[1:]}']").count() == 1
    page.fill("input.search", "rmse better")
    left = page.locator(".numbers tbody:not([hidden]) tr:not([hidden]) td:first-child")
    assert set(left.all_inner_texts()) == {"better"}
    heads = page.locator(".numbers tbody:not([hidden]) th").all_inner_texts()
    assert heads
    assert all("RMSE" in head for head in heads)
    page.fill("input.search", "")
    assert page.locator(".numbers tbody:not([hidden]) tr:not([hidden]) td:first-child").count() > 9
    assert not trouble
