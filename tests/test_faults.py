"""What once gave a wrong picture, lost work or a traceback, group by group."""

from __future__ import annotations

import copy
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir import camera_path, cli, imageio
from mitsuba_restir.cli.writer import Writer
from mitsuba_restir.errors import UsageError, root
from mitsuba_restir.integrators import frame

# ------------------------------ words of the plugin ---------------------------------------------


def tiny() -> mi.Scene:
    film = {"type": "hdrfilm", "width": 4, "height": 4, "rfilter": {"type": "box"}}
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": {"type": "perspective", "film": film},
            "light": {"type": "constant"},
        }
    )


@pytest.mark.parametrize("seed", [-1, 2**32, 1.5, True, "3", None])
def test_a_seed_that_is_none_is_named(rgb, seed):
    renderer = mi.load_dict({"type": "restir_pt"})
    allowed = f"restir_pt: seed must be an integer from 0 to 4294967295, not {seed!r}"
    with pytest.raises(ValueError, match=allowed):
        renderer.render(tiny(), seed=seed, spp=1)


def test_a_seed_for_every_pixel_is_none(rgb):
    renderer = mi.load_dict({"type": "restir_pt"})
    with pytest.raises(ValueError, match="seed must be a single integer, not an array of 3"):
        renderer.render(tiny(), seed=mi.UInt32([1, 2, 3]), spp=1)


@pytest.mark.parametrize("spp", [-1, 2**32, 1.5, True, "3", None])
def test_an_spp_that_is_none_is_named(rgb, spp):
    renderer = mi.load_dict({"type": "restir_pt"})
    allowed = f"restir_pt: spp must be an integer from 0 to 4294967295, not {spp!r}"
    with pytest.raises(ValueError, match=allowed):
        renderer.render(tiny(), spp=spp)


def test_seeds_and_spp_of_every_integer_type_are_the_same(rgb):
    images = []
    for seed, spp in ((7, 2), (np.int64(7), np.uint8(2)), (mi.UInt32(7), 2), (mi.Int32(7), 2)):
        renderer = mi.load_dict({"type": "restir_pt"})
        images.append(np.array(renderer.render(tiny(), seed=seed, spp=spp)))
    for image in images[1:]:
        np.testing.assert_array_equal(image, images[0])
    mi.load_dict({"type": "restir_pt"}).render(tiny(), seed=2**32 - 1, spp=np.int64(0))


def test_the_number_of_samples_may_run_over(rgb):
    """Streams are named by 32 bits; a very long animation starts them again."""
    renderer = mi.load_dict({"type": "restir_pt"})
    scene = tiny()
    renderer.render(scene, spp=1)
    renderer._sample = 2**32 - 1
    images = [np.array(renderer.render(scene, spp=1)) for _ in range(2)]
    assert np.isfinite(images).all()


def test_an_integrator_of_another_variant_is_named(rgb):
    renderer, scene = mi.load_dict({"type": "restir_pt"}), tiny()
    renderer.render(scene, spp=1)
    try:
        mi.set_variant("llvm_ad_mono")
        other = tiny()
        for given in (scene, other):
            with pytest.raises(ValueError, match=r"made under llvm_ad_rgb.* now llvm_ad_mono"):
                renderer.render(given, spp=1)
        own = mi.load_dict({"type": "restir_pt"})
        with pytest.raises(ValueError, match=r"scene.* another variant than llvm_ad_mono"):
            own.render(scene, spp=1)
        with pytest.raises(ValueError, match=r"sensor.* another variant than llvm_ad_mono"):
            own.render(other, sensor=scene.sensors()[0], spp=1)
        assert own.render(other, spp=1).shape == (4, 4, 1)
    finally:
        mi.set_variant("llvm_ad_rgb")
    assert renderer.render(scene, spp=1).shape == (4, 4, 3)


@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, pickle.dumps], ids=["copy", "deepcopy", "pickle"]
)
def test_an_integrator_is_not_copied(rgb, duplicate: Callable[[Any], Any]):
    renderer = mi.load_dict({"type": "restir_pt"})
    with pytest.raises(TypeError, match=r"restir_pt: .* make another one with mi.load_dict"):
        duplicate(renderer)


def endless(**parameters: Any) -> Any:
    """An integrator in a white box from which no path escapes, and a frame of it."""
    film = {"type": "hdrfilm", "width": 8, "height": 4, "rfilter": {"type": "box"}}
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
    scene = mi.load_dict(
        {
            "type": "scene",
            "sensor": {"type": "perspective", "film": film},
            "box": {"type": "cube", "flip_normals": True, "bsdf": white},
        }
    )
    renderer = mi.load_dict({"type": "restir_pt", "spatial": False, **parameters})
    renderer.render(scene, spp=2)
    return renderer


@pytest.mark.parametrize(
    ("parameters", "share"),
    [
        ({"rr_depth": 10_000}, 1.0),
        ({"rr_depth": 10_000, "max_depth": 4096, "mutations": 1}, 1.0),
        ({"rr_depth": 10_000, "max_depth": 4095}, None),
        ({"rr_depth": 10_000, "max_depth": 7}, None),
        ({}, None),
    ],
    ids=["no limit", "a longer limit", "the same limit", "a shorter limit", "roulette"],
)
def test_paths_that_are_cut_are_counted(rgb, parameters, share):
    """Records have room for 4,095 edges; a limit that was asked for is none of their business."""
    assert endless(**parameters).statistics().get("cut") == share


# ------------------------------ camera paths ----------------------------------------------------


def turn(degrees: float, frames: int, **more: Any) -> camera_path.CameraPath:
    """A camera that turns on the spot, given at both ends."""
    far = [1 + 2 * np.sin(np.radians(degrees)), 1.0, 1 + 2 * np.cos(np.radians(degrees))]
    start = {"frame": 0, "origin": [1.0, 1.0, 1.0], "target": [1.0, 1.0, 3.0]}
    end = {"frame": frames - 1, "origin": [1.0, 1.0, 1.0], "target": far, **more}
    return camera_path.from_data({"keyframes": [start, end]})


def straight(keys: list[dict[str, Any]]) -> camera_path.CameraPath:
    return camera_path.from_data({"interpolation": "linear", "keyframes": keys})


def test_a_half_turn_is_refused_and_the_frame_is_named():
    """Halfway the target is where the camera is, so that it looks nowhere."""
    with pytest.raises(UsageError, match=r"frame 3, between keyframes 0 and 1, .*180 degrees"):
        turn(180, 7).check(7)


def test_only_frames_that_are_rendered_matter():
    turn(180, 8).check(8)  # nowhere between frames 3 and 4
    turn(180, 7).check(3)
    turn(179, 7).check(7)
    turn(180, 7).check(0)


def test_a_camera_that_turns_over_or_looks_along_up_is_refused():
    with pytest.raises(UsageError, match=r"frame 3, between keyframes 0 and 1"):
        turn(90, 7, up=[0, -1, 0]).check(7)
    below = {"frame": 0, "origin": [0, 0, 0], "target": [1, -1, 0]}
    above = {"frame": 2, "origin": [0, 0, 0], "target": [-1, 3, 0]}
    middle = {"frame": 5, "origin": [0, 0, 0], "target": [-1, 3, 1]}
    with pytest.raises(UsageError, match=r"frame 1, between keyframes 0 and 1"):
        straight([below, above, middle]).check(6)


def test_frames_beyond_the_last_keyframe_are_its():
    path = turn(90, 3)
    path.check(10**9)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_rounding_does_not_hide_a_frame_without_view(scale):
    """Means of floats are not exact: what is left of the view is noise, at every scale."""
    origin = scale * np.array([0.1, 0.7, 0.3])
    view = scale * np.array([0.3, 0.1, 0.9])
    keys = [
        {"frame": frame, "origin": origin.tolist(), "target": (origin + sign * view).tolist()}
        for frame, sign in ((0, 1), (6, -1), (7, -1))
    ]
    with pytest.raises(UsageError, match="frame 3,"):
        straight(keys).check(8)


def test_nothing_is_rendered_of_a_path_with_such_a_frame(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    lines = [
        f"[[keyframes]]\nframe = {frame}\norigin = [3.5, 1.6, -2.3]\ntarget = [{x}, 1.6, -2.3]"
        for frame, x in ((0, 2.5), (4, 4.5))
    ]
    (tmp_path / "path.toml").write_text("\n".join(lines))
    arguments = ["render", "ajar", "--resolution", "16x9", "--camera-path", "path.toml"]
    assert cli.main([*arguments, "-o", "film/"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "argument --animate: frame 2, between keyframes 0 and 1" in error
    assert [entry.name for entry in tmp_path.iterdir()] == ["path.toml"]


# ------------------------------ a process that is ended -----------------------------------------

COMMAND = [sys.executable, "-m", "mitsuba_restir"]
RENDER = ["render", "ajar", "--resolution", "16x9", "-p", "max_depth=3"]


def wait_for(condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 120
    while not condition():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline
        time.sleep(0.01)


def lines_of(process: subprocess.Popen[str], code: int) -> list[str]:
    """What a process says on standard error, once it has ended with a code."""
    try:
        error = process.communicate(timeout=60)[1]
    finally:
        process.kill()
    assert "Traceback" not in error
    assert "Exception ignored" not in error
    assert process.returncode == code, error
    return error.splitlines()


@pytest.mark.slow
@pytest.mark.parametrize("times", [1, 2], ids=["once", "twice"])
def test_sigterm_keeps_the_average(tmp_path, times):
    """``timeout`` sends it twice, to the process and to its group."""
    picture = tmp_path / "mean.exr"
    marks = tmp_path / "marks.py"
    marks.write_text(MARKING)
    command = [sys.executable, str(marks), *RENDER, "--average", "--frames", "100000"]
    with subprocess.Popen([*command, "-o", str(picture)], **PIPES) as process:
        wait_for((tmp_path / "third").exists, process)
        for _ in range(times):
            process.send_signal(signal.SIGTERM)
        lines = lines_of(process, 143)
    assert lines == ["mitsuba-restir: terminated"]
    frames = int(mi.Bitmap(str(picture)).metadata()["frames averaged"])
    assert frames >= 3
    assert imageio.read_rgb(picture).shape == (9, 16, 3)
    assert not list(tmp_path.glob(".*partial"))


def test_ctrl_c_while_a_frame_is_recorded_comes_out(rgb, monkeypatch):
    """It once counted as a scene that cannot be recorded, and rendering went on."""

    def interrupted(*_: Any) -> Any:
        raise KeyboardInterrupt

    renderer, scene = mi.load_dict({"type": "restir_pt"}), tiny()
    with monkeypatch.context() as context:
        context.setattr(frame, "initial", interrupted)
        with pytest.raises(BaseException) as error:  # noqa: PT011 -- Dr.Jit wraps it
            renderer.render(scene, spp=1)
    assert isinstance(root(error.value), KeyboardInterrupt)
    assert renderer.render(scene, spp=1).shape == (4, 4, 3)
    assert renderer._stages._sample._recordable


PIPES: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}

MARKING = """
import sys
from pathlib import Path
from mitsuba_restir import cli
from mitsuba_restir.cli.writer import Writer

add = Writer.add

def marked(writer, frame, image):
    add(writer, frame, image)
    if frame == 2:
        Path(__file__).with_name("third").touch()

Writer.add = marked
sys.exit(cli.main())
"""

STUDY = """
name = "tiny"
scene = "ajar"
sizes = ["16x9"]
max_depth = 3
frames = 1
runs = 100000
quantities = ["rmse"]
baseline = "one"
[variants.one]
type = "restir_pt"
[reference]
spp = 8
batches = 8
"""


@pytest.mark.slow
def test_sigterm_keeps_the_finished_runs_of_a_study(tmp_path):
    file, out = tmp_path / "tiny.toml", tmp_path / "out"
    file.write_text(STUDY)
    command = [*COMMAND, "evaluate", str(file), "-o", str(out)]
    with subprocess.Popen(command, **PIPES) as process:
        wait_for(lambda: len(list(out.rglob("0*.npz"))) >= 3, process)
        process.send_signal(signal.SIGTERM)
        lines = lines_of(process, 143)
    kept = "finished runs are kept, the same command goes on"
    assert lines == [f"mitsuba-restir: terminated; {kept}"]
    assert not list(out.rglob(".*.partial"))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT], ids=["SIGTERM", "SIGINT"])
def test_an_average_that_is_being_written_is_written(tmp_path, monkeypatch, capsys, number):
    """The signal comes while the last file is made, when the frames are only in memory."""
    encode = imageio.encode_exr

    def interrupted(*arguments: Any) -> bytes:
        signal.raise_signal(number)
        return encode(*arguments)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(imageio, "encode_exr", interrupted)
    arguments = [*RENDER, "--average", "--frames", "2", "-o", "mean.exr"]
    assert cli.main(arguments) == 128 + number
    assert imageio.read_rgb(Path("mean.exr")).shape == (9, 16, 3)
    word = "terminated" if number == signal.SIGTERM else "interrupted"
    assert capsys.readouterr().err == f"mitsuba-restir: {word}\n"
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    assert signal.getsignal(signal.SIGINT) == signal.default_int_handler


def test_the_exit_code_survives_what_python_makes_of_interrupts(tmp_path):
    """``python -m`` ends by SIGINT once KeyboardInterrupt has passed through an exec of text."""
    (tmp_path / "program.py").write_text("""
import sys
from mitsuba_restir import cli
from mitsuba_restir.cli import render
render.run = lambda options: exec("import signal; signal.raise_signal(signal.SIGTERM)")
sys.exit(cli.main(["render", "ajar"]))
""")
    command = [sys.executable, "-m", "program"]
    with subprocess.Popen(command, cwd=tmp_path, **PIPES) as process:
        assert lines_of(process, 143) == ["mitsuba-restir: terminated"]


def test_sums_and_their_number_change_together():
    """A signal may come between any two steps of Python: the mean is right after each."""
    writer = Writer(None, [], [], {}, True, {})
    bad = []

    def watch(at: Any, event: str, argument: Any) -> Any:
        total, count = writer.sum
        if count and not np.array_equal(total / count, np.ones((1, 1, 3))):
            bad.append(at.f_lineno)
        return watch

    sys.settrace(watch)
    try:
        for number in range(3):
            writer.add(number, np.ones((1, 1, 3)))
    finally:
        sys.settrace(None)
    assert writer.frames == 3
    assert not bad


# ------------------------------ standard output -------------------------------------------------

QUICK = {
    "scenes": ["scenes"],
    "help": ["--help"],
    "help of a command": ["evaluate", "--help"],
    "version": ["--version"],
}
SLOW = {
    "doctor": ["doctor"],
    "mask": ["mask", "--size", "16", "-o", "out"],
    "render": [*RENDER, "-o", "out.png"],
    "still": [
        "still",
        "cornell",
        "--resolution",
        "16x9",
        "--plan",
        "light",
        "--frames",
        "2",
        "-o",
        "out.png",
    ],
    "compare": ["compare", "ajar", "--resolution", "16x9", "--frames", "1", "-o", "out"],
    "evaluate": ["evaluate", "tiny.toml", "-o", "out", "-s", "runs=2"],
}
SLOW_PARAMETERS = [pytest.param(name, marks=pytest.mark.slow) for name in SLOW]


def finished(name: str, folder: Path) -> bool:
    """Whether a command has left what it is for."""
    results = {
        "mask": "out/void_and_cluster-16.npy",
        "render": "out.png",
        "still": "out.png",
        "compare": "out/compare.json",
        "evaluate": "out/report.html",
    }
    return name not in results or (folder / results[name]).exists()


@pytest.mark.parametrize("name", [*QUICK, *SLOW_PARAMETERS])
def test_a_closed_pipe_is_silence(tmp_path, name):
    """What reads the output has read enough; the work is done all the same."""
    (tmp_path / "tiny.toml").write_text(STUDY)
    reader, writer = os.pipe()
    os.close(reader)
    command = [*COMMAND, *{**QUICK, **SLOW}[name]]
    with subprocess.Popen(command, cwd=tmp_path, **{**PIPES, "stdout": writer}) as process:
        os.close(writer)
        assert lines_of(process, 0) == []
    assert finished(name, tmp_path)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
@pytest.mark.parametrize("name", [*QUICK, *SLOW_PARAMETERS])
def test_a_full_device_is_one_line(tmp_path, name):
    (tmp_path / "tiny.toml").write_text(STUDY)
    command = [*COMMAND, *{**QUICK, **SLOW}[name]]
    with (
        open("/dev/full", "w") as full,
        subprocess.Popen(command, cwd=tmp_path, **{**PIPES, "stdout": full}) as process,
    ):
        lines = lines_of(process, 1)
    assert lines == ["mitsuba-restir: cannot write standard output: No space left on device"]
    assert finished(name, tmp_path)


@pytest.mark.parametrize("redirection", ["2>/dev/full", "2>&-", ">&-", ">&- 2>&-"])
def test_standard_streams_may_be_gone(redirection):
    command = f'"{sys.executable}" -m mitsuba_restir scenes {redirection}'
    result = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert result.returncode == 0
    assert result.stderr == ""
    command = f'"{sys.executable}" -m mitsuba_restir nothing {redirection}'
    result = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr


# ------------------------------ Ctrl-C before anything runs -------------------------------------

IMPORTING = """
import signal, sys
import importlib.abc

signal.signal(signal.SIGINT, signal.default_int_handler)

class Interrupt(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == {module!r}:
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Interrupt())
sys.argv = ["/usr/bin/mitsuba-restir", "render", "ajar", "--resolution", "4x4"]
from mitsuba_restir.cli import main
sys.exit(main())
"""


@pytest.mark.parametrize(
    "module",
    [
        "drjit",
        "mitsuba",
        "rich",
        "mitsuba_restir.cli.render",
        "mitsuba.python.ad.integrators.prbvolpath",  # by mi.set_variant
        "mitsuba_restir.integrators.restir_pt",
    ],
)
def test_ctrl_c_during_the_import_of_a_command_is_one_line(module):
    program = IMPORTING.format(module=module)
    with subprocess.Popen([sys.executable, "-c", program], **PIPES) as process:
        assert lines_of(process, 130) == ["mitsuba-restir: interrupted"]


def test_ctrl_c_during_the_import_of_the_library_is_ctrl_c():
    program = IMPORTING.format(module="mitsuba").replace("/usr/bin/mitsuba-restir", "my_program")
    program = f"try:\n exec({program!r})\nexcept KeyboardInterrupt:\n sys.exit(7)"
    with subprocess.Popen([sys.executable, "-c", f"import sys\n{program}"], **PIPES) as process:
        assert lines_of(process, 7) == []


# ------------------------------ names that are too long -----------------------------------------

LONG = "a" * 4096


@pytest.mark.parametrize(
    "arguments",
    [
        [*RENDER, "-o", LONG],
        [*RENDER, "-o", f"{LONG}.png"],
        [*RENDER, "-o", f"{LONG}/"],
        [*RENDER, "-o", "a" * 250],
        [*RENDER, "-o", "a" * 240, "--frames", "2"],
        ["render", LONG],
        [*RENDER, "--camera-path", LONG],
        [*RENDER, "--camera-path", f"{LONG}.toml"],
        ["compare", "ajar", "-o", LONG],
        ["compare", LONG],
        ["compare", "ajar", "--reference", LONG],
        ["compare", "ajar", "--make-reference", f"{LONG}.exr"],
        ["compare", "ajar", "--make-reference", "a" * 240 + ".exr"],
        ["evaluate", LONG],
        ["evaluate", "shifts", "-o", LONG],
        ["evaluate", "shifts", "--reference", LONG],
        ["evaluate", "shifts", "--scene", LONG],
        ["mask", "-o", LONG],
    ],
    ids=lambda arguments: " ".join(word[:12] for word in arguments),
)
def test_a_name_that_is_too_long_is_one_line(tmp_path, monkeypatch, capsys, arguments):
    def rendered(*_: Any, **__: Any) -> Any:
        raise AssertionError("a frame was rendered for nothing")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(mi, "render", rendered)
    assert cli.main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "aaaa" in error
    assert not list(tmp_path.iterdir())
