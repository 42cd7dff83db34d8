"""The command line: wrong use ends in one line, results are whole files, Ctrl-C loses nothing."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir import cli, imageio
from mitsuba_restir.cli import loading, output
from mitsuba_restir.cli.parameters import PARAMETERS, parse_parameters
from mitsuba_restir.cli.sequence import Schedule, run_frames
from mitsuba_restir.errors import RenderError, UsageError

SCENE = """<scene version="3.0.0">
    <default name="resx" value="8"/>
    <default name="light" value="1"/>
    <sensor type="perspective">
        <film type="hdrfilm">
            <integer name="width" value="$resx"/>
            <integer name="height" value="6"/>
            <rfilter type="tent"/>
        </film>
    </sensor>
    <emitter type="constant"><rgb name="radiance" value="$light"/></emitter>
</scene>"""


class ConstantIntegrator:
    """Stands in for restir_pt where only the frame loop matters: frame n has the value n."""

    def __init__(self, frames=(), aovs=()):
        self.values = iter(frames)
        self.names = list(aovs)

    def aov_names(self):
        return self.names


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("tiny.xml").write_text(SCENE)
    return tmp_path


@pytest.fixture
def fake_frames(monkeypatch):
    """Render images that hold the frame's number instead of light; an exception is raised."""

    def install(frames, aovs=()):
        values = iter(frames)
        monkeypatch.setattr(loading, "make_integrator", lambda *_: ConstantIntegrator(aovs=aovs))

        def render(*_, **__):
            value = next(values)
            if isinstance(value, BaseException):
                raise value
            return np.full((6, 8, 3 + len(aovs)), float(value), dtype=np.float32)

        monkeypatch.setattr(mi, "render", render)

    return install


def files(folder):
    return sorted(path.name for path in folder.iterdir() if path.name != "tiny.xml")


BAD = {
    "no command": ([], "COMMAND"),
    "unknown command": (["paint"], "render"),
    "unknown option": (["render", "ajar", "--frame", "3"], "--frame"),
    "unknown scene": (["render", "nope"], "ajar"),
    "missing file": (["render", "nope.xml"], "nope.xml"),
    "a folder": (["render", "."], "neither"),
    "zero size": (["render", "ajar", "--resolution", "0x4"], "WIDTHxHEIGHT"),
    "negative size": (["render", "ajar", "--resolution", "-4x4"], "--resolution"),
    "absurd size": (["render", "ajar", "--resolution", "1000000x1000000"], "16384"),
    "nonsense size": (["render", "ajar", "--resolution", "big"], "WIDTHxHEIGHT"),
    "zero spp": (["render", "ajar", "--spp", "0"], "from 1"),
    "nonsense spp": (["render", "ajar", "--spp", "many"], "integer"),
    "zero frames": (["render", "ajar", "--frames", "0"], "from 1"),
    "negative warm-up": (["render", "ajar", "--warmup", "-1"], "from 0"),
    "negative seed": (["render", "ajar", "--seed", "-1"], "from 0"),
    "no time": (["render", "ajar", "--time-budget", "0"], "above 0"),
    "endless time": (["render", "ajar", "--time-budget", "inf"], "above 0"),
    "unknown parameter": (["render", "ajar", "-p", "depth=3"], "max_depth"),
    "parameter without value": (["render", "ajar", "-p", "max_depth"], "name=value"),
    "parameter of wrong type": (["render", "ajar", "-p", "temporal=perhaps"], "true or false"),
    "parameter not a number": (["render", "ajar", "-p", "max_depth=deep"], "integer"),
    "parameter out of range": (["render", "ajar", "-p", "max_depth=-7"], "-1"),
    "parameter infinite": (["render", "ajar", "-p", "confidence_cap=nan"], "confidence_cap"),
    "parameter not a choice": (["render", "ajar", "-p", "shift=sideways"], "hybrid"),
    "parameter twice": (["render", "ajar", "-p", "temporal=true", "-p", "temporal=false"], "twice"),
    "definition of an embedded scene": (["render", "ajar", "-D", "a=1"], "no definitions"),
    "unknown definition": (["render", "tiny.xml", "-D", "resy=4"], "resx, light"),
    "nonsense definition": (["render", "tiny.xml", "-D", "resx=wide"], "wide"),
    "unknown variant": (["render", "ajar", "-m", "llvm"], "llvm_ad_rgb"),
    "scalar variant": (["render", "ajar", "-m", "scalar_rgb"], "llvm_ad_rgb"),
    "polarized variant": (["render", "ajar", "-m", "llvm_ad_spectral_polarized"], "llvm_ad_rgb"),
    "unknown sensor": (["render", "tiny.xml", "--sensor", "3"], "1 sensor"),
    "unknown aov": (["render", "ajar", "--aovs", "colour"], "albedo"),
    "empty aov": (["render", "ajar", "--aovs", ""], "name:type"),
    "aov twice": (["render", "ajar", "--aovs", "depth,depth"], "taken"),
    "wrong suffix": (["render", "ajar", "-o", "out.jpg"], ".exr or .png"),
    "filter and denoiser": (["render", "ajar", "--denoise", "--keep-filter"], "box filter"),
    "missing camera path": (["render", "ajar", "--camera-path", "path.toml"], "path.toml"),
    "no scene to compare": (["compare", ""], "neither a scene file nor"),
    "missing reference": (["compare", "ajar", "--reference", "none.exr"], "none.exr"),
    "reference name": (["compare", "ajar", "--make-reference", "out.png"], ".exr"),
}


def assert_one_line(capsys, code, expected, word):
    captured = capsys.readouterr()
    assert code == expected
    assert captured.out == ""
    assert captured.err.startswith("mitsuba-restir: ")
    assert captured.err.count("\n") == 1
    assert captured.err.endswith("\n")
    assert word in captured.err


@pytest.mark.parametrize("name", BAD)
def test_wrong_use_is_one_line_and_writes_nothing(folder, capsys, name):
    arguments, word = BAD[name]
    assert_one_line(capsys, cli.main(arguments), 2, word)
    assert files(folder) == []


BROKEN = {
    "empty": ("", "not a scene file"),
    "no XML": ("once upon a time", "not a scene file"),
    "unbalanced": ('<scene version="3.0.0"><bsdf></scene>', "line 1"),
    "no version": ("<scene/>", "version"),
    "unknown plugin": ('<scene version="3.0.0"><bsdf type="fur"/></scene>', "fur"),
    "missing mesh": (
        '<scene version="3.0.0"><shape type="obj"><string name="filename" value="gone.obj"/>'
        "</shape></scene>",
        "gone.obj",
    ),
    "no sensor": ('<scene version="3.0.0"><shape type="sphere"/></scene>', "0 sensors"),
    "not a scene": ('<bsdf version="3.0.0" type="diffuse"/>', "no scene"),
    "other film": (SCENE.replace("hdrfilm", "specfilm"), "hdrfilm"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_scene_file_is_one_line(folder, capsys, name):
    text, word = BROKEN[name]
    Path("broken.xml").write_text(text)
    assert_one_line(capsys, cli.main(["render", "broken.xml"]), 2, word)
    assert files(folder) == ["broken.xml"]


def test_binary_scene_file_is_one_line(folder, capsys):
    Path("broken.xml").write_bytes(bytes(range(256)))
    assert_one_line(capsys, cli.main(["render", "broken.xml"]), 2, "not a scene file")


@pytest.mark.parametrize("place", ["file/out.exr", "/proc/out/x.exr"])
def test_unwritable_output_is_one_line(folder, capsys, fake_frames, place):
    fake_frames([1])
    Path("file").touch()
    assert_one_line(capsys, cli.main(["render", "tiny.xml", "-o", place]), 2, "cannot write")
    assert files(folder) == ["file"]


def test_frames_are_numbered_and_hold_what_was_rendered(folder, fake_frames):
    fake_frames([9, 9, 1, 2, 3])
    arguments = ["render", "tiny.xml", "--frames", "3", "--warmup", "2", "-o", "new/out.exr"]
    assert cli.main(arguments) == 0
    names = [f"out_000{frame}{suffix}" for frame in range(3) for suffix in (".exr", ".png")]
    assert files(folder / "new") == names
    for frame in range(3):
        image = imageio.read_rgb(Path(f"new/out_000{frame}.exr"))
        np.testing.assert_array_equal(image, frame + 1)


def test_single_frame_has_no_number_and_replaces_the_old_one(folder, fake_frames):
    fake_frames([1])
    Path("out.exr").write_text("old")
    assert cli.main(["render", "tiny.xml", "-o", "out.exr"]) == 0
    assert files(folder) == ["out.exr", "out.png"]
    assert imageio.read_rgb(Path("out.exr")).shape == (6, 8, 3)


def test_average_is_the_mean_and_names_its_frames(folder, fake_frames):
    fake_frames([1, 2, 6])
    assert cli.main(["render", "tiny.xml", "--frames", "3", "--average", "-o", "out.exr"]) == 0
    assert files(folder) == ["out.exr", "out.png"]
    np.testing.assert_allclose(imageio.read_rgb(Path("out.exr")), 3.0)
    assert mi.Bitmap("out.exr").metadata()["frames averaged"] == "3"


@pytest.mark.parametrize("average", [False, True])
@pytest.mark.parametrize(
    ("failure", "code"), [(KeyboardInterrupt(), 130), (RuntimeError("[x.cpp:1] out of light"), 1)]
)
def test_what_is_finished_survives(folder, fake_frames, capsys, average, failure, code):
    fake_frames([1, 3, failure])
    arguments = ["render", "tiny.xml", "--frames", "9", "-o", "out.exr"]
    assert cli.main([*arguments, *(["--average"] if average else [])]) == code
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    if code == 1:
        assert "out of light" in error
        assert ".cpp" not in error
    if average:
        np.testing.assert_allclose(imageio.read_rgb(Path("out.exr")), 2.0)
    else:
        np.testing.assert_allclose(imageio.read_rgb(Path("out_0001.exr")), 3.0)
        assert not Path("out_0002.exr").exists()


def test_failure_before_the_first_frame_leaves_old_files(folder, fake_frames):
    fake_frames([RuntimeError("no memory")])
    Path("out.exr").write_text("old")
    assert cli.main(["render", "tiny.xml", "-o", "out.exr"]) == 1
    assert Path("out.exr").read_text() == "old"
    assert files(folder) == ["out.exr"]


def test_failed_write_leaves_old_file_and_no_remains(folder, monkeypatch):
    Path("out.exr").write_text("old")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RenderError, match="No space left"):
        imageio.write_atomically(Path("out.exr"), b"new")
    assert Path("out.exr").read_text() == "old"
    assert files(folder) == ["out.exr"]


def test_time_budget_stops_before_a_frame_that_would_not_fit():
    now = [0.0]

    def render(frame):
        now[0] += 1.0
        return np.zeros((1, 1, 3), np.float32)

    def frames(**schedule):
        now[0] = 0.0
        return [frame for frame, _ in run_frames(render, Schedule(**schedule), lambda: now[0])]

    assert frames(frames=None, time_budget=3.5) == [0, 1, 2]
    assert frames(frames=2, time_budget=3.5) == [0, 1]
    assert frames(frames=None, warmup=2, time_budget=3.5) == [0]
    assert frames(frames=4, warmup=9, time_budget=0.5) == [0]


def test_default_names():
    assert output.plan(None, "veach/scene.xml", True).name(7) == Path("veach_0007")
    assert output.plan(None, "ajar", False).name(0) == Path("ajar")
    assert output.plan("a/b", "ajar", False) == output.Output(Path("a/b"), False, False)
    assert output.plan("a/b/", "ajar", False).stem == Path("a/b/ajar")
    assert output.plan("b.1.png", "ajar", False) == output.Output(Path("b.1"), True, False)
    with pytest.raises(UsageError, match="suffix"):
        output.plan("a.tiff", "ajar", False)


def test_scene_gets_size_definitions_and_a_box_filter(folder):
    loading.choose_variant("llvm_ad_rgb")
    scene = loading.load_scene("tiny.xml", {"resx": "12"}, None)
    film = scene.sensors()[0].film()
    assert list(film.size()) == [12, 6]
    assert "Box" in str(film.rfilter())
    film = loading.load_scene("tiny.xml", {}, (5, 4), keep_filter=True).sensors()[0].film()
    assert list(film.size()) == [5, 4]
    assert "Tent" in str(film.rfilter())


def test_definition_of_an_included_file_is_known(folder):
    Path("outer.xml").write_text('<scene version="3.0.0"><include filename="tiny.xml"/></scene>')
    loading.choose_variant("llvm_ad_rgb")
    scene = loading.load_scene("outer.xml", {"resx": "12"}, None)
    assert list(scene.sensors()[0].film().size()) == [12, 6]


def test_lights_come_in_the_order_of_the_file(folder):
    """Those of meshes, which Mitsuba puts into an order of addresses; other meshes are merged."""
    names = [f"lamp_{i}" for i in range(9)]
    lamps = (f'<shape type="cube" id="{name}"><emitter type="area"/></shape>' for name in names)
    things = '<bsdf type="diffuse" id="m"/>' + 5 * '<shape type="cube"><ref id="m"/></shape>'
    scene = f'{things}<emitter type="point"/>{"".join(lamps)}'
    Path("lamps.xml").write_text(f'<scene version="3.0.0">{scene}</scene>')
    loading.choose_variant("llvm_ad_rgb")
    shapes = loading.load_scene("lamps.xml", {}, None).shapes()
    assert [shape.id() for shape in shapes if shape.is_emitter()] == names
    assert len(shapes) == len(names) + 1


def test_what_a_file_merges_itself_stays_merged(folder):
    lamp = '<shape type="cube" id="lamp"><emitter type="area"/></shape>'
    Path("own.xml").write_text(f'<scene version="3.0.0"><shape type="merge">{lamp}</shape></scene>')
    loading.choose_variant("llvm_ad_rgb")
    for apart in (False, True):
        (shape,) = loading.load_scene("own.xml", {}, None, apart=apart).shapes()
        assert shape.id() == "lamp"


def test_every_parameter_is_known_to_the_plugin():
    loading.choose_variant("llvm_ad_rgb")
    for name, parameter in PARAMETERS.items():
        text = str(parameter.default).lower()
        assert parse_parameters({name: text}) == {name: parameter.default}
        loading.make_integrator("restir_pt", {name: parameter.default})


def test_scenes_lists_names_and_what_they_are(capsys):
    assert cli.main(["scenes"]) == 0
    assert "ajar  " in capsys.readouterr().out


@pytest.mark.slow
def test_render_writes_aovs_under_mitsuba_s_names(folder):
    arguments = ["render", "ajar", "--resolution", "32x18", "--aovs", "albedo,n:sh_normal,depth"]
    assert cli.main([*arguments, "-o", "out.exr", "-p", "max_depth=3"]) == 0
    names = [field.name for field in mi.Bitmap("out.exr").struct_()]
    layers = ["albedo.R", "albedo.G", "albedo.B", "depth.T", "n.X", "n.Y", "n.Z"]
    assert sorted(names) == sorted(["R", "G", "B", *layers])


@pytest.mark.slow
def test_mono_variant_writes_grey(folder):
    try:
        arguments = ["render", "tiny.xml", "-m", "llvm_ad_mono", "--aovs", "depth"]
        assert cli.main([*arguments, "-o", "out.exr"]) == 0
    finally:
        mi.set_variant("llvm_ad_rgb")
    image = np.array(mi.Bitmap("out.exr"))
    assert image.shape == (6, 8, 4)
    np.testing.assert_array_equal(image[..., 0], image[..., 1])


@pytest.mark.slow
def test_denoised_picture_is_written_beside(folder):
    pytest.importorskip("mitsuba_oidn")
    arguments = ["render", "ajar", "--resolution", "32x18", "--frames", "2", "--denoise"]
    assert cli.main([*arguments, "-o", "out.exr", "-p", "max_depth=3"]) == 0
    assert {"out_0001.exr", "out_denoised_0001.exr", "out_denoised_0001.png"} < set(files(folder))
    bitmap = mi.Bitmap("out_0000.exr")
    assert bitmap.channel_count() == 3
    assert np.isfinite(imageio.read_rgb(Path("out_denoised_0000.exr"))).all()


@pytest.mark.slow
def test_camera_path_moves_the_sensor(folder):
    Path("path.toml").write_text("""
        [[keyframes]]
        frame = 0
        origin = [0, 0, 0]
        target = [0, 0, 1]
        fov = 40
        [[keyframes]]
        frame = 2
        origin = [0, 0, 0]
        target = [1, 0, 0]
        fov = 60
    """)
    scene = SCENE.replace(
        "</scene>",
        '<shape type="sphere"><point name="center" x="4" y="0" z="0"/>'
        '<bsdf type="diffuse"/></shape></scene>',
    )
    Path("ball.xml").write_text(scene)
    arguments = ["render", "ball.xml", "--camera-path", "path.toml", "-o", "out.exr"]
    assert cli.main([*arguments, "--aovs", "depth"]) == 0
    assert len(list(folder.glob("out_*.exr"))) == 3
    first, last = (np.array(mi.Bitmap(f"out_000{frame}.exr"))[2:4, 3:5, 3] for frame in (0, 2))
    assert np.all(first < 0.1)
    # From 3 in the middle to 3.3 at the corners of these pixels.
    np.testing.assert_allclose(last, 3.15, atol=0.2)


@pytest.mark.slow
def test_interrupting_the_process_keeps_whole_files(folder):
    command = [sys.executable, "-m", "mitsuba_restir", "render", "ajar", "--resolution", "32x18"]
    options = ["--frames", "100000", "-o", "out.exr", "-p", "max_depth=3"]
    # A background job of a shell starts with the signal ignored, and hands that on.
    heard = signal.signal(signal.SIGINT, signal.default_int_handler)
    with subprocess.Popen([*command, *options], stderr=subprocess.PIPE, text=True) as process:
        signal.signal(signal.SIGINT, heard)
        deadline = time.monotonic() + 120
        while not Path("out_0002.png").exists() and time.monotonic() < deadline:
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        try:
            error = process.communicate(timeout=60)[1]
        finally:
            process.kill()
    assert process.returncode == 130
    assert error.strip().endswith("interrupted")
    assert "Traceback" not in error
    for path in folder.glob("out_*.exr"):
        assert imageio.read_rgb(path).shape == (18, 32, 3)
    assert not list(folder.glob(".*partial"))
