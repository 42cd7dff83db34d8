"""The viewer as it runs: in a real browser, and against those who mean it no good."""

from __future__ import annotations

import json
import shlex
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from support.viewer import Running, viewer

from benchmarks import viewer as benchmark
from mitsuba_restir.cli import main

pytest.importorskip("nicegui", reason="the viewer needs pip install 'mitsuba-restir[view]'")

SIZE = (96, 54)
SCENE = ("cornell", "--resolution", f"{SIZE[0]}x{SIZE[1]}")
PATIENCE = 30_000
"""Milliseconds for a picture: kernels may have to be compiled."""

POLLING = "_nicegui_ws/socket.io/?EIO=4&transport=polling"
SOCKETS = ("stream", "_nicegui_ws/socket.io/?EIO=4&transport=websocket")


@pytest.fixture(scope="module")
def running() -> Iterator[Running]:
    with viewer(*SCENE) as started:
        yield started


@pytest.fixture
def page(running: Running, browser: Any) -> Iterator[Any]:
    opened = _open(browser, running.url)
    trouble: list[str] = []
    opened.on("pageerror", lambda error: trouble.append(str(error)))
    yield opened
    opened.context.close()
    assert trouble == []


def _open(browser: Any, url: str) -> Any:
    opened = browser.new_context(viewport={"width": 900, "height": 640}).new_page()
    opened.goto(url)
    opened.wait_for_function("document.documentElement.dataset.number > 0", timeout=PATIENCE)
    return opened


def _number(page: Any) -> int:
    return int(page.evaluate("document.documentElement.dataset.number"))


def _wait_for_next(page: Any, pictures: int = 1) -> None:
    until = _number(page) + pictures
    page.wait_for_function(f"document.documentElement.dataset.number >= {until}", timeout=PATIENCE)


def _pixels(page: Any) -> np.ndarray:
    """What is on the canvas, (H, W, 3)."""
    values = page.evaluate(
        """() => {
            const canvas = document.getElementById("picture");
            const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
            return [canvas.width, canvas.height, Array.from(data.data)];
        }"""
    )
    width, height, data = values
    return np.array(data, dtype=np.uint8).reshape(height, width, 4)[..., :3]


def _until(page: Any, true: Callable[[], bool]) -> None:
    """Wait while the page goes on."""
    end = time.monotonic() + PATIENCE / 1000
    while not true():
        assert time.monotonic() < end
        page.wait_for_timeout(50)


def _full(page: Any) -> np.ndarray:
    """What is on the canvas once it has all pixels: while the camera moves, it has fewer."""
    found: list[np.ndarray] = []

    def full() -> bool:
        found[:] = [_pixels(page)]
        return found[0].shape[:2] == (SIZE[1], SIZE[0])

    _until(page, full)
    return found[0].astype(float)


def _drag(page: Any, dx: int, dy: int) -> None:
    box = page.locator("#picture").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=6)
    page.mouse.up()


# ------------------------------ a browser -------------------------------------------------------


def test_the_picture_follows_the_mouse_and_goes_home(page: Any) -> None:
    page.locator('[data-control="accumulate"]').click()
    _wait_for_next(page, 2)
    before = _full(page)
    assert before.mean() > 20
    _drag(page, 200, 40)
    _wait_for_next(page, 3)
    away = np.abs(_full(page) - before).mean()
    page.keyboard.press("h")
    # Frames are noisy: the last of these have a history again.
    _wait_for_next(page, 8)
    back = np.abs(_full(page) - before).mean()
    assert away > 1.5 * back
    page.locator('[data-control="accumulate"]').click()


def test_a_resting_picture_becomes_a_still(page: Any) -> None:
    _until(page, lambda: "still" in page.inner_text("#facts"))
    assert _pixels(page).shape == (SIZE[1], SIZE[0], 3)


def test_a_slider_acts(page: Any) -> None:
    bright = _pixels(page).mean()
    slider = page.locator('[data-control="exposure"]')
    box = slider.bounding_box()
    slider.click(position={"x": 0.25 * box["width"], "y": box["height"] / 2})
    _until(page, lambda: _pixels(page).mean() < 0.5 * bright)
    slider.click(position={"x": 0.5 * box["width"], "y": box["height"] / 2})
    _until(page, lambda: _pixels(page).mean() > 0.9 * bright)


def test_a_parameter_acts_and_the_command_says_so(page: Any) -> None:
    page.locator('[data-control="spatial"]').click()
    page.locator('[aria-label="The command that renders this"]').click()
    page.wait_for_function("document.querySelector('.command')?.textContent")
    assert "-p spatial=false" in page.inner_text(".command")
    page.get_by_role("button", name="Close").click()
    page.locator('[data-control="spatial"]').click()


def test_a_divided_picture(page: Any) -> None:
    page.locator("#picture").focus()
    page.keyboard.press("c")
    page.locator("#divider").wait_for(state="visible")
    page.locator(".sides .q-btn").nth(1).click()
    page.locator(".line", has_text="View").locator(".q-field").click()
    page.get_by_role("option", name="Depth", exact=True).click()
    _until(page, lambda: "units" in page.inner_text("#scale"))
    page.locator("#picture").focus()
    page.keyboard.press(" ")
    _until(page, lambda: "frozen" in page.inner_text("#facts"))
    page.wait_for_timeout(200)
    before = _pixels(page).astype(float)
    box = page.locator("#divider").bounding_box()
    picture = page.locator("#picture").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(picture["x"] + 0.2 * picture["width"], box["y"] + 20, steps=4)
    page.mouse.up()
    after = _pixels(page).astype(float)
    columns = np.abs(after - before).mean(axis=(0, 2))
    assert columns[round(0.25 * SIZE[0]) : round(0.45 * SIZE[0])].mean() > 10
    assert (columns[: round(0.15 * SIZE[0])] == 0).all()
    page.keyboard.press(" ")
    page.keyboard.press("c")
    page.locator("#divider").wait_for(state="hidden")


def test_a_screenshot_is_the_picture(page: Any) -> None:
    page.locator("#picture").focus()
    with page.expect_download() as download:
        page.keyboard.press("p")
    shot = np.array(Image.open(download.value.path()))
    assert shot.shape == (SIZE[1], SIZE[0], 3)
    assert shot.mean() > 20


def test_frozen_frames_come_one_by_one(page: Any) -> None:
    page.locator("#picture").focus()
    page.keyboard.press(" ")
    _until(page, lambda: "frozen" in page.inner_text("#facts"))
    page.wait_for_timeout(300)
    number = _number(page)
    page.wait_for_timeout(300)
    assert _number(page) == number
    page.keyboard.press(".")
    _until(page, lambda: _number(page) > number)
    page.keyboard.press(" ")
    _until(page, lambda: "frozen" not in page.inner_text("#facts"))


def test_two_browsers_see_the_same_and_the_first_leads(page: Any, browser: Any) -> None:
    other = _open(browser, page.url)
    _drag(page, 60, 0)
    _until(other, lambda: "another browser has the camera" in other.inner_text("#facts"))
    page.locator("#picture").focus()
    page.keyboard.press(" ")
    for each in (page, other):
        _until(each, lambda each=each: "frozen" in each.inner_text("#facts"))
    _until(page, lambda: _number(page) == _number(other))
    assert (_pixels(page) == _pixels(other)).all()
    number = _number(page)
    _drag(other, 60, 0)
    page.wait_for_timeout(400)
    assert _number(page) == _number(other) == number
    page.keyboard.press(" ")
    other.context.close()


def test_the_command_renders_what_is_seen(page: Any, tmp_path: Path) -> None:
    page.locator('[data-control="accumulate"]').click()
    page.locator("#picture").focus()
    page.keyboard.press("h")
    _drag(page, 90, 30)
    page.wait_for_timeout(500)
    _full(page)
    page.locator('[aria-label="The command that renders this"]').click()
    page.wait_for_function("document.querySelector('.command')?.textContent")
    lines = page.inner_text(".command").splitlines()
    assert "view.json" in lines[0]
    program = shlex.join([sys.executable, "-m", "mitsuba_restir"])
    script = "\n".join(lines).replace("mitsuba-restir", program, 1)
    subprocess.run(["sh", "-c", script], cwd=tmp_path, check=True, capture_output=True)

    def likeness(name: str) -> float:
        rendered = np.array(Image.open(tmp_path / name))[..., :3].astype(float)
        return float(np.corrcoef(rendered.ravel(), _full(page).ravel())[0, 1])

    # Two frames of one view are 0.90 to 0.91 alike, since both are noisy; of two views, -0.1 to 0.
    _until(page, lambda: likeness("view.png") > 0.8)
    # The control: as the camera was before.
    assert main(["render", *SCENE, "--warmup", "5", "-o", str(tmp_path / "home.png")]) == 0
    assert likeness("home.png") < 0.5


# ------------------------------ refusals and hostility ------------------------------------------


def _status(url: str, **headers: str) -> int:
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers)) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code


def _socket_status(url: str, **headers: str) -> int:
    """What a websocket is answered; 101 where it is opened."""
    client = pytest.importorskip("websockets.sync.client")
    exceptions = pytest.importorskip("websockets.exceptions")
    try:
        origin = headers.pop("Origin", None)
        with client.connect(
            url.replace("http", "ws", 1), origin=origin, additional_headers=headers, proxy=None
        ):
            return 101
    except exceptions.InvalidStatus as error:
        return int(error.response.status_code)


def test_foreign_origins_are_refused(running: Running) -> None:
    own = {"Origin": running.url.rstrip("/")}
    evil = {"Origin": "http://evil.example"}
    for path in ("", "static/viewer.js", "screenshot.png", POLLING):
        assert _status(running.url + path, **own) == 200, path
        assert _status(running.url + path, **evil) == 403, path
    for path in SOCKETS:
        assert _socket_status(running.url + path, **own) == 101, path
        assert _socket_status(running.url + path, **evil) == 403, path
    assert _status(running.url, Host="evil.example") == 403


def test_nothing_is_served_without_the_token() -> None:
    with viewer(*SCENE, "--host", "0.0.0.0") as out:
        address, token = out.url.split("/?token=")
        url = f"http://127.0.0.1:{address.rpartition(':')[2]}/"
        for path in ("", "static/viewer.js", "screenshot.png", POLLING, "nothing"):
            assert _status(url + path) == 403, path
            assert _status(url + path, Cookie="mitsuba_restir=1") == 403, path
        for path in SOCKETS:
            assert _socket_status(url + path) == 403, path
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        with opener.open(f"{url}?token={token}") as answer:
            assert answer.status == 200
            assert "token" not in answer.url
        with opener.open(url + "static/viewer.js") as answer:
            assert answer.status == 200
        assert _status(f"{url}?token={token}x") == 403


def test_hostile_messages_do_not_stop_it(running: Running) -> None:
    client = pytest.importorskip("websockets.sync.client")
    exceptions = pytest.importorskip("websockets.exceptions")
    url = running.url.replace("http", "ws", 1)
    nonsense = ["", "{", "null", "[[[[", '{"type":"drag"}', '{"type":"seen","number":1e999}', "\0"]
    begin = time.monotonic()
    with client.connect(url + "stream", proxy=None) as socket:
        for index in range(1000):
            socket.send(nonsense[index % len(nonsense)])
        socket.send(b"\xff" * 1000)
        told: dict[str, Any] = {}
        while not told.get("complaint"):
            received = socket.recv(PATIENCE / 1000)
            told = json.loads(received) if isinstance(received, str) else told
        assert "not a message" in told["complaint"]
    assert time.monotonic() - begin < 10
    with client.connect(url + "stream", proxy=None) as socket:
        socket.send("x" * (1 << 20))
        with pytest.raises(exceptions.ConnectionClosed):
            deque(iter(lambda: socket.recv(PATIENCE / 1000), None), 0)
    with client.connect(url + SOCKETS[1], proxy=None) as socket:
        for text in (
            "40",
            '42["event"]',
            "42[",
            '42["event",{"id":1,"client_id":"x"}]',
            "9",
            "40/x,",
        ):
            for _ in range(100):
                socket.send(text)
    # Vanished without a word.
    with client.connect(url + "stream", proxy=None) as socket:
        socket.socket.shutdown(2)
    assert _status(running.url + "screenshot.png?divider=nan") == 422
    assert _status(running.url + "screenshot.png?divider=0.1") == 200
    with client.connect(url + "stream", proxy=None) as socket:
        while isinstance(socket.recv(PATIENCE / 1000), str):
            pass
    assert running.process.poll() is None


# ------------------------------ beginning and end -----------------------------------------------


def _ended(browser: Any, number: int, code: int) -> float:
    """Seconds from a signal to the end of a viewer that a page looks at."""
    with viewer(*SCENE) as started:
        page = _open(browser, started.url)
        begin = time.monotonic()
        started.process.send_signal(number)
        assert started.process.wait(60) == code
        seconds = time.monotonic() - begin
        assert started.process.stderr is not None
        assert started.process.stderr.read().count("\n") == 1
        page.context.close()
    return seconds


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_it_in_two_seconds(number: int, code: int, browser: Any) -> None:
    # Other programs may keep a viewer from the processor: the least of three is its own.
    assert any(_ended(browser, number, code) < 2.0 for _ in range(3))


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["no_such_scene"], "no_such_scene"),
        (["cornell", "--port", "1", "--host", "203.0.113.1"], "203.0.113.1"),
        (["cornell", "-p", "mutation_acceptance=energy"], "mutations"),
        (["cornell", "--fps", "fast"], "--fps"),
        (["cornell", "--reference", "no_such.exr"], "no_such.exr"),
    ],
)
def test_wrong_use_is_said_in_a_line(
    arguments: list[str], word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", *arguments]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert word in said


def test_without_nicegui_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("mitsuba_restir.cli.view.importlib.util.find_spec", lambda name: None)
    assert main(["view"]) == 2
    assert "mitsuba-restir[view]" in capsys.readouterr().err


def test_the_benchmark_measures() -> None:
    with benchmark.started("cornell", "32x18", 0) as started:
        rate, latencies = benchmark.received(started, 0.3)
        assert rate > 1
        assert 0 < min(latencies) <= max(latencies) < 10
        assert not started.resident() < 50


NOTEBOOK = """
import urllib.request, time
import mitsuba_restir
from mitsuba_restir import scenes
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")

def shown(viewer):
    assert f'<iframe src="{viewer.url}"' in viewer._repr_html_()
    for _ in range(300):
        try:
            return urllib.request.urlopen(viewer.url + "screenshot.png").read()
        except urllib.error.HTTPError:
            time.sleep(0.1)

scene = scenes.load("cornell", 48, 27)
first = shown(mitsuba_restir.view(scene, spatial_neighbors=2))
last = mitsuba_restir.view(scenes.load("gloss", 48, 27), preset="fast")
assert first[:4] == b"\\x89PNG" and first != shown(last)
last.close()
assert mi.render(scene, spp=1).shape == (27, 48, 3)
"""


def test_in_a_notebook() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", NOTEBOOK], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stderr == ""
