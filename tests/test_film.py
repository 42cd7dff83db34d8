"""``render --animate``: numbered frames and films, and what a kill leaves."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from PIL import Image

from mitsuba_restir import cli, imageio
from mitsuba_restir.cli import sequence as frames_of
from mitsuba_restir.sequence import WARMUP, video

SCENE = """
<scene version="3.0.0">
    <sensor type="perspective">
        <float name="fov" value="50"/>
        <transform name="to_world"><lookat origin="0,1,4" target="0,0.5,0" up="0,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="25"/><integer name="height" value="15"/>
        </film>
    </sensor>
    <shape type="rectangle" id="floor">
        <transform name="to_world"><rotate x="1" angle="-90"/><scale value="5"/></transform>
    </shape>
    <shape type="sphere" id="ball"><float name="radius" value="0.5"/>
        <point name="center" x="-1" y="0.5" z="0"/></shape>
    <shape type="sphere" id="other"><float name="radius" value="0.5"/>
        <point name="center" x="-1" y="0.5" z="-2"/></shape>
    <emitter type="constant"/>
</scene>
"""
FRAMES = 5
ANIMATION = """
fps = 12
[[tracks]]
parameter = "ball.to_world"
keyframes = [{frame = 0}, {frame = 4, translate = [2, 0, 0]}]
"""


@pytest.fixture
def film(rgb, tmp_path, monkeypatch) -> list[str]:
    """A command line but for its output; the current folder is new."""
    monkeypatch.chdir(tmp_path)
    Path("ball.xml").write_text(SCENE)
    Path("a.toml").write_text(ANIMATION)
    return ["render", "ball.xml", "--animate", "a.toml", "-p", "max_depth=2", "--spp", "4"]


def decoded(path: str) -> tuple[list[np.ndarray], float]:
    """The frames of a film, and its frames per second."""
    if path.endswith(".webp"):
        with Image.open(path) as image:
            frames = []
            for index in range(image.n_frames):
                image.seek(index)
                frames.append(np.array(image.convert("RGB")))
            return frames, 1000 / image.info["duration"]
    import av

    with av.open(path) as container:
        rate = float(container.streams.video[0].average_rate)
        return [f.to_ndarray(format="rgb24") for f in container.decode(video=0)], rate


def test_numbered_frames_are_what_moves(film):
    assert cli.main([*film, "-o", "out.exr"]) == 0
    images = [imageio.read_rgb(Path(f"out_{i:04d}.exr")) for i in range(FRAMES)]
    assert len(list(Path().glob("out_*.exr"))) == FRAMES
    assert np.abs(images[0] - images[-1]).mean() > 0.02


@pytest.mark.parametrize("suffix", video.SUFFIXES)
def test_a_film_has_the_frames(film, suffix):
    if suffix != ".webp":
        pytest.importorskip("av")
    assert cli.main([*film, "-o", f"film{suffix}"]) == 0
    frames, rate = decoded(f"film{suffix}")
    assert (len(frames), round(rate)) == (FRAMES, 12)
    assert sorted(p.name for p in Path().iterdir()) == ["a.toml", "ball.xml", f"film{suffix}"]
    assert cli.main([*film, "--frames", "1", "-o", "first.png"]) == 0
    first = np.array(Image.open("first.png").convert("RGB")).astype(float)
    shown = frames[0][: first.shape[0], : first.shape[1]].astype(float)
    # Chroma has half the resolution, and what is compressed is not exact.
    assert np.abs(shown - first).mean() < 6
    assert np.abs(frames[-1].astype(float)[: first.shape[0], : first.shape[1]] - first).mean() > 8


def test_a_denoised_film(film):
    pytest.importorskip("mitsuba_oidn")
    assert cli.main([*film, "-o", "film.webp", "--denoise"]) == 0
    assert len(decoded("film.webp")[0]) == FRAMES


def test_finished_frames_stay(film, monkeypatch):
    assert cli.main([*film, "-o", "out/"]) == 0
    before = {p: p.read_bytes() for p in Path("out").iterdir()}
    Path("out/ball_0003.exr").unlink()
    rendered = []
    shown = frames_of.run_frames
    monkeypatch.setattr(
        "mitsuba_restir.cli.render.run_frames",
        lambda render, schedule: shown(lambda f: (rendered.append(f), render(f))[1], schedule),
    )
    assert cli.main([*film, "-o", "out/", "--resume"]) == 0
    assert rendered == [0, 1, 2, 3, 4]
    kept = [p for p in before if p.name[5:9] in ("0000", "0001", "0002")]
    assert len(kept) == 6
    assert all(p.read_bytes() == before[p] for p in kept)
    assert Path("out/ball_0003.exr").exists()
    rendered.clear()
    assert cli.main([*film, "-o", "out/", "--resume"]) == 0
    assert rendered == []
    assert cli.main([*film, "-o", "out/", "--resume", "--frames", "30"]) == 0
    assert rendered == list(range(max(0, FRAMES - WARMUP), 30))


def test_other_frames_are_not_gone_on_with(film, capsys):
    assert cli.main([*film, "-o", "out/", "--frames", "1"]) == 0
    for more, word in ((["--seed", "3"], "seed"), (["--resolution", "16x9"], "size")):
        assert cli.main([*film, "-o", "out/", "--resume", *more, "--frames", "2"]) == 2
        error = capsys.readouterr().err
        assert f"--resume: {word} is not what" in error
        assert error.count("\n") == 1
    Path("a.toml").write_text(ANIMATION.replace("translate = [2", "translate = [1"))
    assert cli.main([*film, "-o", "out/", "--resume"]) == 2
    assert "--resume: animation is not what" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "word"),
    [
        (["-o", "film.mp4", "--average"], "--average"),
        (["-o", "out/", "--average", "--resume"], "--resume"),
        (["-o", "film.avi"], "must end in"),
        (["--animate", "none.toml"], "cannot read the animation none.toml"),
    ],
)
def test_wrong_use(film, capsys, more, word):
    assert cli.main([*film, *more]) == 2
    error = capsys.readouterr().err
    assert word in error
    assert error.count("\n") == 1


def test_without_av_a_film_says_what_to_install(film, capsys, monkeypatch):
    monkeypatch.setattr(video.importlib.util, "find_spec", lambda name: None)
    assert cli.main([*film, "-o", "film.mp4"]) == 2
    assert "mitsuba-restir[video]" in capsys.readouterr().err


@pytest.mark.slow
def test_a_killed_film_is_gone_on_with(film):
    pytest.importorskip("av")
    command = [sys.executable, "-m", "mitsuba_restir", *film, "--frames", "60", "-o", "film.mp4"]
    parts = Path("film.mp4.frames")
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 120
        while not (parts / "frame_0002.png").exists() and time.monotonic() < deadline:
            assert process.poll() is None
            time.sleep(0.02)
        process.kill()
    assert not Path("film.mp4").exists()
    kept = {p.name: p.read_bytes() for p in parts.glob("frame_*.png")}
    assert 3 <= len(kept) < 60
    assert json.loads((parts / "frame_animation.json").read_text())["spp"] == "4"

    seen = {}
    finish = video.write

    def watched(path: Path, frames: object, fps: float) -> None:
        seen.update({p.name: p.read_bytes() for p in parts.glob("frame_*.png")})
        finish(path, frames, fps)  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(video, "write", watched)
        assert cli.main([*film, "--frames", "60", "-o", "film.mp4", "--resume"]) == 0
    assert len(seen) == 60
    assert all(seen[name] == data for name, data in kept.items())
    assert len(decoded("film.mp4")[0]) == 60
    assert not parts.exists()


def test_objects_keep_their_names(film):
    """Mitsuba would merge spheres of one material, and nothing could be animated by name."""
    scene = cli.loading.load_scene("ball.xml", {}, None, apart=True)
    assert "other.to_world" in mi.traverse(scene)
