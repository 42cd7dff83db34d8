"""The report: its parts, its numbers, and the page in a real browser."""

from __future__ import annotations

import csv
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_restir.studies.reference as reference_module
import mitsuba_restir.studies.runner as runner
from mitsuba_restir.analysis.intervals import Interval
from mitsuba_restir.errors import UsageError
from mitsuba_restir.studies import Study, cache, load_study, run
from mitsuba_restir.studies.notebook import Results
from mitsuba_restir.studies.rendering import Renderer
from mitsuba_restir.studies.report.headline import headline
from mitsuba_restir.studies.report.pictures import diverging, galleries, sequential
from mitsuba_restir.studies.results import Measured, ReferenceImage, Row, Run

STUDY = """
name = "drawn"
about = "First.\\n\\nThen <b>more</b>."
scene = "ajar"
sizes = ["64x40"]
frames = 3
runs = 4
keep = "all"
seed = 5
quantities = ["rmse", "relmse_trimmed", "covariance", "equal_time", "time"]

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


def test_maps_have_the_colours_they_say() -> None:
    colours = diverging(np.array([[-1.0, 0.0, 1.0, np.nan]]))[0]
    assert colours[0][2] > colours[0][0]
    np.testing.assert_array_equal(colours[1], [255, 255, 255])
    assert colours[2][0] > colours[2][2]
    brightness = sequential(np.linspace(0.0, 1.0, 9)[None])[0].astype(int).sum(axis=1)
    assert np.all(np.diff(brightness) > 0)


def test_a_bias_is_seen(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    truth = np.full((32, 32, 3), 0.5)
    noise = 0.05 * rng.standard_normal((8, 32, 32, 3))
    noise[:, :8, :8] += 0.05
    images = [(truth + e).astype(np.float32) for e in noise]
    runs = {"a": [Run(image, image, np.zeros(1)) for image in images]}
    reference = ReferenceImage(truth, np.zeros_like(truth))
    data = Measured("32x32", runs, "a", {}, reference, 0.01, 0.0)
    (bias,) = (gallery for gallery in galleries(data) if gallery.key == "bias")
    blocks = bias.pictures["a"][::4, ::4]
    full = diverging(np.ones((1, 1)))[0, 0]
    beyond = np.all(blocks == full, axis=2)
    assert beyond[0, 0]
    assert beyond.sum() == 1


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
    assert "python -m mitsuba_restir.studies" in text
    ids = re.findall(r' id="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    figures = {f.name for f in (results.path / "figures" / "64x40").iterdir()}
    assert {"radial_spectrum.svg", "radial_spectrum.png", "convergence_frames.svg"} <= figures
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
    assert float(first["relmse"]) == pytest.approx(float(first["relmse_of_average"]))
    # Independent frames: three have a third of the error, and take three times as long.
    ratio = float(last["relmse_of_average"]) / float(first["relmse_of_average"])
    assert 0.2 < ratio < 0.5
    assert float(last["seconds"]) == pytest.approx(0.03)


def test_numbers_as_a_data_frame_and_a_figure(results: Results) -> None:
    pandas = pytest.importorskip("pandas")
    frame = results.frame()
    assert isinstance(frame, pandas.DataFrame)
    better = frame[(frame.quantity == "RMSE") & (frame.variant == "better")]
    assert better.p_value.item() <= 1.0
    assert better.ratio.item() == pytest.approx(0.5, abs=0.1)
    assert results.figure("RMSE").axes[0].get_xlabel() == "RMSE"
    with pytest.raises(UsageError, match=r"no 'SMAPE' at 64x40: there are RMSE"):
        results.figure("SMAPE")


@pytest.fixture
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="the browser test needs playwright: pip install playwright"
    )
    names = ("chromium", "chromium-browser", "google-chrome")
    found = os.environ.get("MITSUBA_RESTIR_CHROMIUM") or next(
        filter(None, map(shutil.which, names)), None
    )
    if found is None:
        pytest.skip("no Chromium found: install it (Debian: sudo apt install chromium)")
    with playwright.sync_playwright() as driver:
        # Containers run as root, where Chromium has no sandbox.
        chromium = driver.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield chromium
        chromium.close()


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
    assert rows.locator("th").all_inner_texts() == ["plain", "better"]
    heads = page.locator("table.headline thead th").all_inner_texts()
    cell = rows.nth(1).locator("td").nth(heads.index("RMSE") - 1)
    shown = float(cell.locator("b").inner_text())
    row = next(r for r in results.table.rows if r.quantity == "RMSE" and r.variant == "better")
    assert shown == pytest.approx(row.value.value, rel=1e-3)
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
    assert not trouble
