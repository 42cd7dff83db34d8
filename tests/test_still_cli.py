"""``mitsuba-restir still``: what it writes, what it says, and that nothing is ever lost."""

from __future__ import annotations

import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from support.disks import refuse

from mitsuba_restir import cli
from mitsuba_restir.arrays import load_arrays
from mitsuba_restir.still.frames import Frames
from mitsuba_restir.still.pilot import Choice
from mitsuba_restir.still.plan import PLANS
from mitsuba_restir.still.preview import Preview

PLAN = "spp=1,spatial_rounds=2,spatial_radius=4"
TINY = ["still", "cornell", "--resolution", "16x9", "--max-depth", "3", "--plan", PLAN, "-o", "a"]
"""Every EXR of this picture is made by these words; frames are to be added."""

DARK = """<scene version="3.0.0">
    <sensor type="perspective"><film type="hdrfilm">
        <integer name="width" value="8"/><integer name="height" value="6"/>
    </film></sensor>
    <shape type="sphere"/>
</scene>"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def channels(path: str | Path) -> dict[str, np.ndarray]:
    bitmap = mi.Bitmap(str(path))
    values = np.array(bitmap)
    return {field.name: values[..., i] for i, field in enumerate(bitmap.struct_())}


def assert_same(one: str | Path, other: str | Path) -> None:
    first, second = channels(one), channels(other)
    assert first.keys() == second.keys()
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name], err_msg=name)


def said(capsys) -> list[str]:
    """Lines of standard error, each of the program's own."""
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith("mitsuba-restir: ") for line in lines), lines
    return [line.removeprefix("mitsuba-restir: ") for line in lines]


# ------------------------------ what is written -------------------------------------------------


def test_a_still_has_its_error_and_says_how_it_was_made(folder, capsys):
    assert cli.main([*TINY, "--frames", "5", "--aovs", "far:depth,albedo", "-p", "rr_depth=4"]) == 0
    assert files(folder) == ["a.checkpoint", "a.exr", "a.png"]
    found = channels("a.exr")
    colour = ["R", "G", "B"]
    assert set(found) == {
        *colour,
        *(f"standard_error.{name}" for name in colour),
        *(f"albedo.{name}" for name in colour),
        "far.T",
    }
    for name in colour:
        assert found[name].mean() > 0
        assert 0 < found[f"standard_error.{name}"].mean() < 2 * found[name].mean()
    metadata = mi.Bitmap("a.exr").metadata()
    assert metadata["frames"] == "5"
    assert metadata["plan"].startswith(PLAN)
    assert metadata["why"] == "asked for"
    assert float(metadata["error"]) <= float(metadata["error of all pixels"])
    assert float(metadata["seconds"]) > 0
    out = capsys.readouterr().out
    assert re.search(r"5 frames in [\d.]+ s, error 0\.\d+ \(0\.\d+ with all pixels\): a\.exr", out)


def test_a_still_stops_at_its_error(folder):
    assert cli.main([*TINY, "--error", "0.5", "--checkpoint-every", "0"]) == 0
    assert files(folder) == ["a.exr", "a.png"]
    metadata = mi.Bitmap("a.exr").metadata()
    assert float(metadata["error"]) <= 0.5
    assert int(metadata["frames"]) in (4, 5, 7, 9, 12, 15, 19, 24, 30, 38)


def test_a_denoised_still(folder):
    pytest.importorskip("mitsuba_oidn")
    assert cli.main([*TINY, "--frames", "3", "--denoise", "--checkpoint-every", "0"]) == 0
    assert files(folder) == ["a.exr", "a.png", "a_denoised.exr", "a_denoised.png"]
    assert not any("albedo" in name for name in channels("a.exr"))
    assert channels("a_denoised.exr")["R"].shape == (9, 16)


def test_a_scene_without_light_is_a_black_picture_and_a_sentence(folder, capsys):
    Path("dark.xml").write_text(DARK)
    assert cli.main(["still", "dark.xml", "--plan", "light", "-o", "a"]) == 0
    assert files(folder) == ["a.exr", "a.png", "dark.xml"]
    assert not any(values.any() for values in channels("a.exr").values())
    assert "there is no light in the scene: the picture is black\n" in capsys.readouterr().out


# ------------------------------ wrong use -------------------------------------------------------

BAD = {
    "no error": (["--error", "0"], "above 0"),
    "negative error": (["--error", "-0.1"], "above 0"),
    "endless error": (["--error", "inf"], "above 0"),
    "two goals": (["--error", "0.1", "--frames", "3"], "not allowed with"),
    "two other goals": (["--time-budget", "1", "--frames", "3"], "not allowed with"),
    "one frame": (["--frames", "1"], "from 2"),
    "no time": (["--time-budget", "0"], "above 0"),
    "unknown plan": (["--plan", "much"], "no plan 'much'; use one of "),
    "wrong plan": (["--plan", "spp=0"], "spp must be"),
    "history": (["-p", "temporal=true"], "its frames are independent"),
    "preset": (["-p", "preset=fast"], "it has plans instead"),
    "biased": (["-p", "mutation_acceptance=energy"], "a still cannot have"),
    "previews of nothing": (["-p", "blue_noise=selection"], "what is shown of a still while it"),
    "no such previews": (["-p", "blue_noise=blue", "--tev", "localhost"], "blue_noise must be"),
    "previews of no reuse": (
        ["--plan", "spp=1,spatial=false", "-p", "blue_noise=selection", "--tev", "localhost"],
        "argument --plan: 'spp=1,spatial=false' has no spatial reuse",
    ),
    "how previews are seen": (["-p", "blue_noise_sigma=1"], "needs blue_noise=selection"),
    "seen from too far": (["-p", "blue_noise_sigma=9"], "blue_noise_sigma must be"),
    "unknown parameter": (["-p", "depth=3"], "no parameter 'depth'"),
    "parameter out of range": (["-p", "spatial_rounds=99"], "from 1 to 16"),
    "depth twice": (["-p", "max_depth=3", "--max-depth", "2"], "not allowed with"),
    "unknown aov": (["--aovs", "colour"], "albedo"),
    "checkpoints": (["--checkpoint-every", "-1"], "above 0"),
    "nothing to resume": (["--resume"], "nothing to resume: no file a.checkpoint"),
    "no host": (["--tev", ":14158"], "HOST:PORT"),
    "no port": (["--tev", "localhost:tev"], "HOST:PORT"),
    "suffix": (["-o", "a.jpg"], ".exr or .png"),
    "no folder": (["-o", "/proc/a/b.exr"], "cannot write"),
}


@pytest.mark.parametrize("name", BAD)
def test_wrong_use_is_one_line_and_writes_nothing(folder, capsys, name):
    words, expected = BAD[name]
    depth = [] if name == "depth twice" else ["--max-depth", "3"]
    assert cli.main(["still", "cornell", "-o", "a", *depth, *words]) == 2
    (line,) = said(capsys)
    assert expected in line
    assert files(folder) == []


def test_a_checkpoint_of_something_else_is_refused_and_stays(folder, capsys):
    assert cli.main([*TINY, "--frames", "2"]) == 0
    before = {path: path.read_bytes() for path in folder.iterdir()}
    capsys.readouterr()
    others = {
        "another seed: 0, not 1": ["--seed", "1"],
        "another size: 16x9, not 8x5": ["--resolution", "8x5"],
        "another plan: ": ["--plan", "light"],
        "another set of parameters: max_depth=3, not max_depth=4": ["--max-depth", "4"],
        "another set of auxiliary images: none, not depth=depth": ["--aovs", "depth"],
    }
    for expected, words in others.items():
        assert cli.main([*TINY, "--frames", "3", "--resume", *words]) == 2
        (line,) = said(capsys)
        assert expected in line
    assert cli.main(["still", "gloss", *TINY[2:], "--frames", "3", "--resume"]) == 2
    (line,) = said(capsys)
    assert line.endswith("it is of another scene")
    Path("a.checkpoint").write_bytes(before[folder / "a.checkpoint"][:-100])
    assert cli.main([*TINY, "--frames", "3", "--resume"]) == 2
    (line,) = said(capsys)
    assert line.startswith("a.checkpoint cannot be resumed: it cannot be read")
    Path("a.checkpoint").write_bytes(before[folder / "a.checkpoint"])
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


# ------------------------------ nothing is lost -------------------------------------------------


def test_a_finished_still_goes_on(folder, capsys):
    """To a smaller error or with more frames, with the plan that it has; as if never stopped."""
    assert cli.main([*TINY, "--frames", "5"]) == 0
    words = [word for word in TINY if word not in ("--plan", PLAN)]
    assert cli.main([*words, "--frames", "9", "--resume"]) == 0
    assert cli.main([*TINY[:-1], "b", "--frames", "9"]) == 0
    assert_same("a.exr", "b.exr")
    error = float(mi.Bitmap("a.exr").metadata()["error"])
    assert cli.main([*words, "--error", str(0.7 * error), "--resume"]) == 0
    assert int(mi.Bitmap("a.exr").metadata()["frames"]) > 9
    # It is there already: nothing is rendered, and the picture is written again.
    Path("a.exr").unlink()
    assert cli.main([*words, "--frames", "5", "--resume"]) == 0
    assert int(mi.Bitmap("a.exr").metadata()["frames"]) > 9


def failing_at(monkeypatch, frame: int, failure: BaseException) -> None:
    """Have a failure come when a frame is rendered, before anyone gets it."""
    render, count = Frames.render, [0]

    def counted(self: Frames) -> Any:
        count[0] += 1
        image = render(self)
        if count[0] == frame:
            raise failure
        return image

    monkeypatch.setattr(Frames, "render", counted)


@pytest.mark.parametrize("guided", ["true", "false"])
def test_ctrl_c_leaves_the_picture_so_far(folder, capsys, monkeypatch, guided):
    words = [*TINY, "-p", f"guiding={guided}"]
    with monkeypatch.context() as patch:
        failing_at(patch, 6, KeyboardInterrupt())
        assert cli.main([*words, "--frames", "9"]) == 130
    assert said(capsys) == ["interrupted; --resume goes on from a.checkpoint"]
    assert mi.Bitmap("a.exr").metadata()["frames"] == "5"
    assert cli.main([*words, "--frames", "9", "--resume"]) == 0
    assert cli.main([*words, "-o", "b", "--frames", "9"]) == 0
    assert_same("a.exr", "b.exr")


def test_ctrl_c_before_the_first_frame_leaves_nothing(folder, capsys, monkeypatch):
    failing_at(monkeypatch, 1, KeyboardInterrupt())
    assert cli.main([*TINY, "--frames", "9"]) == 130
    assert said(capsys) == ["interrupted"]
    assert files(folder) == []


def test_a_failure_leaves_the_picture_so_far(folder, capsys, monkeypatch):
    failing_at(monkeypatch, 4, RuntimeError("[x.cpp:1] out of light"))
    assert cli.main([*TINY, "--frames", "9"]) == 1
    (line,) = said(capsys)
    assert line == "rendering failed: out of light"
    assert mi.Bitmap("a.exr").metadata()["frames"] == "3"
    assert "a.checkpoint" in files(folder)


@pytest.mark.slow
@pytest.mark.parametrize("guided", ["true", "false"])
def test_a_still_that_is_killed_goes_on_bit_by_bit(folder, guided):
    """SIGKILL at three moments after the first checkpoint, one resumed after the other."""
    words = [*TINY, "--aovs", "depth", "-p", f"guiding={guided}"]
    kept = Path("a.checkpoint")
    frames = 0
    for seconds in (0.0, 0.21, 0.34):
        more = ["--resume"] if kept.exists() else []
        command = [sys.executable, "-m", "mitsuba_restir", *words, *more]
        command += ["--frames", "100000", "--checkpoint-every", "0.001"]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
            while process.poll() is None and frames_in(kept) <= frames:
                time.sleep(0.01)
            time.sleep(seconds)
            process.send_signal(signal.SIGKILL)
        assert process.returncode == -signal.SIGKILL
        assert frames_in(kept) > frames
        frames = frames_in(kept)
    asked = ["--frames", str(frames + 7)]
    assert cli.main([*words, *asked, "--resume"]) == 0
    assert cli.main([*words, *asked, "-o", "b"]) == 0
    assert_same("a.exr", "b.exr")


def frames_in(path: Path) -> int:
    return int(load_arrays(path)[1]["frames"]) if path.exists() else 0


def test_a_full_disk_loses_nothing(tiny_disk, folder, capsys):
    out = ["-o", str(tiny_disk / "a")]
    assert cli.main([*TINY, *out, "--frames", "4"]) == 0
    kept = (tiny_disk / "a.checkpoint").read_bytes()
    capsys.readouterr()
    ballast = tiny_disk / "ballast"
    filled = 0
    with ballast.open("wb", buffering=0) as file:
        try:
            while True:
                filled += file.write(bytes(512))
        except OSError:
            pass
    assert filled
    assert cli.main([*TINY, *out, "--frames", "7", "--resume"]) == 1
    lines = said(capsys)
    assert len(lines) == 2
    assert all("No space left on device" in line for line in lines)
    assert (tiny_disk / "a.checkpoint").read_bytes() == kept
    assert not list(tiny_disk.glob(".*"))
    ballast.unlink()
    assert cli.main([*TINY, *out, "--frames", "7", "--resume"]) == 0
    assert cli.main([*TINY, "-o", "b", "--frames", "7"]) == 0
    assert_same(tiny_disk / "a.exr", "b.exr")


def test_a_checkpoint_that_cannot_be_written_does_not_end_the_still(folder, capsys, monkeypatch):
    refuse(monkeypatch, ".checkpoint")
    assert cli.main([*TINY, "--frames", "3"]) == 0
    (line,) = said(capsys)
    assert line.startswith("cannot write a.checkpoint: No space left on device")
    assert files(folder) == ["a.exr", "a.png"]


# ------------------------------ tev -------------------------------------------------------------


class Listener(threading.Thread):
    """Stands for tev: takes one connection and keeps the packets that come over it."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        self.packets: list[bytes] = []

    def run(self) -> None:
        with self.socket:
            connection, _ = self.socket.accept()
        with connection, connection.makefile("rb") as stream:
            while head := stream.read(4):
                (size,) = struct.unpack("<I", head)
                self.packets.append(stream.read(size - 4))

    @property
    def pictures(self) -> list[np.ndarray]:
        """What was shown: packets, but for the first, end with pixels, 9 rows of 16 of RGB."""
        return [
            np.frombuffer(packet[-9 * 16 * 3 * 4 :], "<f4").reshape(9, 16, 3)
            for packet in self.packets[1:]
        ]


def rgb_of(file: str) -> np.ndarray:
    """The colours of an EXR, (H, W, 3)."""
    written = channels(file)
    return np.stack([written[name] for name in "RGB"], axis=-1)


CREATE, UPDATE = 4, 6


def test_tev_is_sent_the_growing_picture(folder, capsys):
    pytest.importorskip("tevclient")
    listener = Listener()
    listener.start()
    assert cli.main([*TINY, "--frames", "4", "--tev", f"127.0.0.1:{listener.port}"]) == 0
    listener.join(10)
    assert said(capsys) == []
    kinds = [packet[0] for packet in listener.packets]
    assert kinds[0] == CREATE
    assert len(kinds) >= 3
    assert set(kinds[1:]) == {UPDATE}
    assert listener.packets[0][2:4] == b"a\0"
    assert struct.unpack("<iii", listener.packets[0][4:16]) == (16, 9, 3)
    np.testing.assert_array_equal(listener.pictures[-1], rgb_of("a.exr"))


def test_tev_is_sent_previews_and_at_last_what_is_written(folder, monkeypatch):
    pytest.importorskip("tevclient")
    assert cli.main([*TINY, "--frames", "4"]) == 0
    Path("a.exr").rename("plain.exr")
    monkeypatch.setattr("mitsuba_restir.cli.still.SHOWN_EVERY", 0.0)
    listener = Listener()
    listener.start()
    place = f"127.0.0.1:{listener.port}"
    words = ["--frames", "4", "--tev", place, "-p", "blue_noise=selection"]
    assert cli.main([*TINY, *words]) == 0
    listener.join(10)
    assert_same("plain.exr", "a.exr")
    shown, picture = listener.pictures, rgb_of("a.exr")
    assert len(shown) == 5
    np.testing.assert_array_equal(shown[-1], picture)
    assert (shown[-2] != picture).any()
    np.testing.assert_allclose(shown[-2].mean(), picture.mean(), rtol=1e-5)


def test_where_the_plan_found_has_no_reuse_the_mean_is_shown_and_it_is_said(
    folder, capsys, monkeypatch
):
    pytest.importorskip("tevclient")
    bare = Choice(PLANS["candidates"], "it was the first", 0.0)
    monkeypatch.setattr("mitsuba_restir.still.driver.pilot", lambda *_: bare)
    words = [word for word in TINY if word not in ("--plan", PLAN)]
    listener = Listener()
    listener.start()
    place = f"127.0.0.1:{listener.port}"
    asked = ["--frames", "2", "--tev", place, "-p", "blue_noise=selection"]
    assert cli.main([*words, *asked]) == 0
    (line,) = said(capsys)
    assert line.endswith("nothing to choose from; the plain mean is shown")


@pytest.mark.parametrize("gone_after", [0, 1])
def test_what_nobody_sees_is_not_steered(folder, monkeypatch, gone_after):
    """With no tev at all, or from the frame on after which it has gone."""
    tevclient = pytest.importorskip("tevclient")
    monkeypatch.setattr("mitsuba_restir.cli.still.SHOWN_EVERY", 0.0)
    steered = []
    add = Preview.add
    monkeypatch.setattr(Preview, "add", lambda self, *args: (steered.append(1), add(self, *args)))
    listener = Listener()
    if gone_after:
        listener.start()

        def gone(*_: object) -> None:
            raise BrokenPipeError(32, "Broken pipe")

        monkeypatch.setattr(tevclient.Ipc, "update_image", gone)
    else:
        listener.socket.close()
    place = f"127.0.0.1:{listener.port}"
    asked = ["--frames", "4", "--tev", place, "-p", "blue_noise=selection"]
    assert cli.main([*TINY, *asked]) == 0
    assert len(steered) == gone_after
    assert mi.Bitmap("a.exr").metadata()["frames"] == "4"


def test_tev_is_left_with_what_is_written_when_interrupted(folder, monkeypatch):
    pytest.importorskip("tevclient")
    monkeypatch.setattr("mitsuba_restir.cli.still.SHOWN_EVERY", 0.0)
    failing_at(monkeypatch, 3, KeyboardInterrupt())
    listener = Listener()
    listener.start()
    place = f"127.0.0.1:{listener.port}"
    asked = ["--frames", "9", "--tev", place, "-p", "blue_noise=selection"]
    assert cli.main([*TINY, *asked]) == 130
    listener.join(10)
    shown, picture = listener.pictures, rgb_of("a.exr")
    assert len(shown) == 3
    assert (shown[-2] != picture).any()
    np.testing.assert_array_equal(shown[-1], picture)


def test_tev_is_sent_nothing_when_there_is_nothing(folder, monkeypatch):
    pytest.importorskip("tevclient")
    failing_at(monkeypatch, 1, KeyboardInterrupt())
    listener = Listener()
    listener.start()
    assert cli.main([*TINY, "--frames", "9", "--tev", f"127.0.0.1:{listener.port}"]) == 130
    listener.join(10)
    assert listener.packets == []


def test_without_a_tev_rendering_goes_on(folder, capsys):
    pytest.importorskip("tevclient")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    assert cli.main([*TINY, "--frames", "2", "--tev", f"127.0.0.1:{port}"]) == 0
    (line,) = said(capsys)
    assert line == f"no tev at 127.0.0.1:{port} (Connection refused); rendering goes on"
    assert "a.exr" in files(folder)


def test_a_tev_that_goes_away_is_one_line(folder, capsys, monkeypatch):
    tevclient = pytest.importorskip("tevclient")

    def gone(*_: object) -> None:
        raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr(tevclient.Ipc, "update_image", gone)
    listener = Listener()
    listener.start()
    assert cli.main([*TINY, "--frames", "3", "--tev", f"127.0.0.1:{listener.port}"]) == 0
    (line,) = said(capsys)
    assert "Broken pipe" in line
    assert "rendering goes on" in line


def test_without_the_extra_rendering_goes_on(folder, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "tevclient", None)
    assert cli.main([*TINY, "--frames", "2", "--tev", "localhost"]) == 0
    (line,) = said(capsys)
    assert line == "--tev needs pip install 'mitsuba-restir[tev]'; rendering goes on"
    assert "a.exr" in files(folder)
