"""The viewer: time to the first picture, frames a second, mouse to picture, and memory.

``python -m benchmarks.viewer [SCENE] [--sizes 256x144 640x360] [--minutes 10]`` starts the viewer
in a process of its own. The camera orbits all the time, and all pixels are rendered (``--fps 0``),
so that every picture is a frame with a history. Without a browser pictures are only received.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import math
import re
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mitsuba_restir.cli import machine

PATIENCE = 60.0
"""Seconds for a picture: kernels may have to be compiled."""

STEP = 0.004
"""What the camera orbits between two pictures, in heights of the picture."""

SETTLED = 20
"""Pictures that are not counted at the beginning."""


@dataclass(frozen=True)
class Viewer:
    """A running viewer: its process, address, and when it was started."""

    process: subprocess.Popen[str]
    url: str
    begin: float

    def resident(self) -> float:
        """Memory of the server [MB]; NaN where the system does not say it as Linux does."""
        try:
            text = Path(f"/proc/{self.process.pid}/status").read_text()
        except OSError:
            return math.nan
        found = re.search(r"VmRSS:\s*(\d+) kB", text)
        return int(found[1]) / 1024 if found else math.nan


@contextlib.contextmanager
def started(scene: str, size: str, fps: int) -> Iterator[Viewer]:
    """A viewer, ended at the end."""
    begin = time.perf_counter()
    command = [sys.executable, "-m", "mitsuba_restir", "view", scene]
    command += ["--resolution", size, "--fps", str(fps)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        assert process.stdout is not None
        found = re.search(r"http://\S+", process.stdout.readline())
        if found is None:
            raise SystemExit("benchmarks.viewer: the viewer did not start")
        yield Viewer(process, found[0], begin)
    finally:
        process.terminate()
        process.communicate()


class Client:
    """Receives pictures, and moves the camera, as the page does."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket

    def send(self, **message: Any) -> None:
        """Send a message."""
        self._socket.send(json.dumps(message))

    def turn(self, step: float = STEP) -> None:
        """Orbit a little."""
        self.send(type="drag", how="orbit", dx=step, dy=0.0)

    def picture(self, patience: float = PATIENCE) -> dict[str, Any]:
        """The facts of the next picture, which counts as seen."""
        while True:
            data = self._socket.recv(patience)
            if isinstance(data, bytes):
                (length,) = struct.unpack_from("<I", data)
                facts: dict[str, Any] = json.loads(data[4 : 4 + length])
                self.send(type="seen", number=facts["number"])
                return facts


@contextlib.contextmanager
def connected(viewer: Viewer) -> Iterator[Client]:
    """A client of a viewer."""
    from websockets.sync.client import connect

    url = viewer.url.replace("http", "ws", 1) + "stream"
    with connect(url, proxy=None) as socket:
        yield Client(socket)


def first_picture(scene: str, size: str) -> float:
    """Seconds from the command to the first picture in a client's hands."""
    with started(scene, size, 0) as viewer, connected(viewer) as client:
        client.picture()
        return time.perf_counter() - viewer.begin


def received(viewer: Viewer, seconds: float) -> tuple[float, list[float]]:
    """Frames a second without a browser, and times from a message to its picture [s]."""
    with connected(viewer) as client:
        for _ in range(SETTLED):
            client.turn()
            client.picture()
        begin, count, latencies = time.perf_counter(), 0, []
        while time.perf_counter() - begin < seconds:
            client.turn()
            client.picture()
            count += 1
        rate = count / (time.perf_counter() - begin)
        for pause in itertools.islice(itertools.cycle((0.0, 0.013, 0.029, 0.041)), 40):
            before = client.picture()["camera"]
            time.sleep(pause)
            asked = time.perf_counter()
            client.turn(0.02)
            while client.picture()["camera"] == before:
                pass
            latencies.append(time.perf_counter() - asked)
        return rate, latencies


_TIMED = """() => {
  window.latencies = [];
  const canvas = document.getElementById("picture");
  let asked = null, before = null;
  const camera = () => JSON.stringify(viewer.facts().camera);
  canvas.addEventListener("pointermove", () => {
    if (asked === null) [asked, before] = [performance.now(), camera()];
  });
  const look = () => {
    if (asked !== null && camera() !== before) {
      latencies.push(performance.now() - asked);
      asked = null;
    }
    requestAnimationFrame(look);
  };
  look();
}"""


def seen(viewer: Viewer, seconds: float) -> tuple[float, list[float]]:
    """Frames a second in Chromium without a screen, and times from the mouse to a picture [s]."""
    from playwright.sync_api import sync_playwright

    number = "Number(document.documentElement.dataset.number || 0)"
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=machine.browser(), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(viewer.url)
        page.wait_for_function(f"{number} > 0", timeout=1000 * PATIENCE)
        page.evaluate(_TIMED)
        box = page.locator("#picture").bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()

        def sweep(duration: float) -> None:
            end = time.perf_counter() + duration
            for step in itertools.count():
                page.mouse.move(x + 150 * math.sin(0.02 * step), y)
                page.wait_for_timeout(20)
                if time.perf_counter() > end:
                    return

        sweep(4.0)
        page.evaluate("latencies.length = 0")
        first, begin = int(page.evaluate(number)), time.perf_counter()
        sweep(seconds)
        rate = (int(page.evaluate(number)) - first) / (time.perf_counter() - begin)
        latencies = [ms / 1e3 for ms in page.evaluate("latencies")]
        browser.close()
    return rate, latencies


def memory(scene: str, size: str, minutes: float) -> list[float]:
    """Memory of the server [MB] from minute to minute, with a moving camera and pauses."""
    found: list[float] = []
    with started(scene, size, 15) as viewer, connected(viewer) as client:
        begin = time.perf_counter()
        while (spent := time.perf_counter() - begin) < 60 * minutes:
            # Half of the time the camera rests, and a still grows, or is finished.
            if spent % 20 < 10:
                client.turn(STEP if spent % 40 < 20 else -STEP)
            with contextlib.suppress(TimeoutError):
                client.picture(1.0)
            if spent >= 60 * len(found):
                found.append(viewer.resident())
        found.append(viewer.resident())
    return found


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.viewer", description=__doc__)
    parser.add_argument("scene", nargs="?", default="ajar", help="scene (ajar)")
    parser.add_argument("--sizes", nargs="+", default=["256x144", "640x360"])
    parser.add_argument("--seconds", type=float, default=10.0, help="for each rate (10)")
    parser.add_argument("--minutes", type=float, default=10.0, help="of the memory's (10)")
    parser.add_argument("--no-browser", action="store_true", help="leave the browser out")
    options = parser.parse_args()
    for size in options.sizes:
        times = [first_picture(options.scene, size) for _ in range(2)]
        print(f"{size}: first picture after {times[0]:.2f} s, once more {times[1]:.2f} s")
        kinds = {"without a browser": received} | (
            {} if options.no_browser else {"with a browser": seen}
        )
        for name, measure in kinds.items():
            with started(options.scene, size, 0) as viewer:
                rate, latencies = measure(viewer, options.seconds)
            low, middle, high = 1e3 * np.quantile(latencies, [0.1, 0.5, 0.9])
            print(
                f"{size}, {name}: {rate:.1f} frames/s; to the picture {middle:.0f} ms "
                f"(10-90 %: {low:.0f}-{high:.0f})",
                flush=True,
            )
    if options.minutes > 0:
        found = memory(options.scene, options.sizes[0], options.minutes)
        rest = " ".join(f"{value:.0f}" for value in found)
        print(f"{options.sizes[0]}: memory of the server, minute by minute [MB]: {rest}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
