"""``mitsuba-restir render``: a sequence of frames, to files."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mitsuba as mi

from .. import __version__, camera_path
from ..analysis.denoise import GUIDES
from ..errors import UsageError, rendering
from ..imageio import RGB, Image, with_rgb
from ..integrators.parameters import asking_for
from ..passes.shade import AOVS
from . import denoising, loading, output
from .arguments import as_dict, assignment, integer, positive_seconds, resolution
from .parameters import parse_aovs, parse_parameters
from .sequence import Schedule, run_frames
from .signals import held
from .writer import DENOISED, Writer

MAX_FRAMES = 1_000_000
MAX_SPP = 65_536


def add_scene_arguments(parser: argparse.ArgumentParser, scene: str | None = None) -> None:
    """Add what every command that loads a scene accepts; the scene may have a default."""
    parser.add_argument(
        "scene",
        metavar="SCENE",
        nargs="?" if scene else None,
        default=scene,
        help="an XML file, or an embedded scene's name" + (f" ({scene})" if scene else ""),
    )
    parser.add_argument(
        "-D",
        dest="definitions",
        metavar="NAME=VALUE",
        type=assignment,
        action="append",
        default=[],
        help="replace a <default> of the scene file (may be repeated)",
    )
    parser.add_argument(
        "-p",
        dest="parameters",
        metavar="PARAM=VALUE",
        type=assignment,
        action="append",
        default=[],
        help="set a parameter of restir_pt (may be repeated)",
    )
    parser.add_argument("-m", dest="variant", metavar="VARIANT", help="Mitsuba variant")
    parser.add_argument(
        "--resolution", metavar="WxH", type=resolution, help="size in pixels (the scene's own)"
    )
    parser.add_argument(
        "--seed", metavar="N", type=integer(0, 2**32 - 1), default=0, help="random seed (0)"
    )
    parser.add_argument(
        "-s", "--sensor", metavar="N", type=integer(0), default=0, help="which sensor (0)"
    )


def add_aovs_argument(parser: argparse.ArgumentParser) -> None:
    """Add what every command that writes auxiliary images accepts."""
    parser.add_argument(
        "--aovs",
        metavar="LIST",
        help=f"extra channels in the EXR, separated by commas: {', '.join(AOVS)}, each also as "
        "name:type",
    )


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "render",
        help="render a sequence of frames",
        description="Render a sequence of frames with restir_pt, as EXR and PNG.",
    )
    add_scene_arguments(parser)
    parser.add_argument(
        "-o",
        dest="output",
        metavar="OUT",
        help="a name (EXR and PNG), a name ending in .png (PNG only), or a folder; frames get "
        "numbers; existing files are replaced",
    )
    parser.add_argument(
        "--frames", metavar="N", type=integer(1, MAX_FRAMES), help="frames to keep (1)"
    )
    parser.add_argument(
        "--warmup",
        metavar="N",
        type=integer(0, MAX_FRAMES),
        default=0,
        help="frames to render and throw away first (0)",
    )
    parser.add_argument(
        "--spp",
        metavar="N",
        type=integer(1, MAX_SPP),
        default=1,
        help="initial candidate paths per pixel and frame (1)",
    )
    parser.add_argument(
        "--camera-path", metavar="FILE", type=Path, help="keyframes, in JSON or TOML"
    )
    parser.add_argument(
        "--time-budget",
        metavar="S",
        type=positive_seconds,
        help="stop after S seconds; without --frames, render as many as fit",
    )
    parser.add_argument(
        "--average", action="store_true", help="write one picture, the mean of all frames"
    )
    add_aovs_argument(parser)
    parser.add_argument(
        "--denoise",
        action="store_true",
        help="also write each picture denoised (OIDN); takes preset=denoised where -p gives none",
    )
    parser.add_argument(
        "--keep-filter",
        action="store_true",
        help="keep the scene's reconstruction filter instead of a box",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Render; 0 when all frames are written."""
    start = time.perf_counter()
    definitions = as_dict(options.definitions, "-D")
    parameters = parse_parameters(as_dict(options.parameters, "-p"))
    aovs = parse_aovs(options.aovs) if options.aovs is not None else {}
    if options.denoise and options.keep_filter:
        raise UsageError("argument --denoise: needs the box filter, leave out --keep-filter")
    if options.denoise:
        denoising.require()
        parameters = {"preset": denoising.PRESET, **parameters}
    path = camera_path.load(options.camera_path) if options.camera_path else None
    schedule = _schedule(options, path)
    numbered = not options.average and schedule.frames != 1
    target = output.plan(options.output, options.scene, numbered)

    variant = loading.choose_variant(options.variant)
    guides = _guides(aovs) if options.denoise else {}
    wanted = {**aovs, **{name: kind for kind, name in guides.items()}}
    if wanted:
        parameters["aovs"] = asking_for(wanted)
    integrator = loading.make_integrator("restir_pt", parameters)
    scene = loading.load_scene(options.scene, definitions, options.resolution, options.keep_filter)
    sensor = loading.choose_sensor(scene, options.sensor)
    channels = [*RGB, *integrator.aov_names()]
    move = _camera_mover(sensor, path) if path else None
    extra = DENOISED if options.denoise else ""
    output.prepare_folder(target.stem.parent, f"{target.name(MAX_FRAMES - 1, extra).name}.exr")

    metadata = {
        "mitsuba-restir": __version__,
        "scene": options.scene,
        "variant": variant,
        "spp": str(options.spp),
        "seed": str(options.seed),
        "parameters": " ".join(f"{name}={value}" for name, value in parameters.items()),
    }
    writer = Writer(target, channels, _kept(channels, aovs), guides, options.average, metadata)

    def render_frame(frame: int) -> Image:
        if move:
            move(max(frame, 0))
        image = mi.render(
            scene, integrator=integrator, sensor=sensor, spp=options.spp, seed=options.seed
        )
        return with_rgb(image, len(channels) - len(RGB))

    try:
        with rendering():
            for frame, image in run_frames(render_frame, schedule):
                writer.add(frame, image)
    finally:
        with held():
            writer.finish()
            _report(writer, start)
    return 0


def _schedule(options: argparse.Namespace, path: camera_path.CameraPath | None) -> Schedule:
    frames = options.frames
    if frames is None and path is not None:
        frames = path.length
    if frames is None and options.time_budget is None:
        frames = 1
    if frames is not None and frames > MAX_FRAMES:
        raise UsageError(f"the camera path has {frames} frames, more than {MAX_FRAMES}")
    if path is not None:
        _check_views(path, frames or MAX_FRAMES)
    return Schedule(frames, options.warmup, options.time_budget)


def _check_views(path: camera_path.CameraPath, frames: int) -> None:
    try:
        path.check(frames)
    except UsageError as error:
        raise UsageError(f"argument --camera-path: {error}") from error


def _guides(aovs: Mapping[str, str]) -> dict[str, str]:
    """Name of an AOV of each type that guides the denoiser, taken from those asked for or new."""
    names = {kind: name for name, kind in aovs.items()}
    return {kind: names.get(kind, f"denoiser_{kind}") for kind in GUIDES}


def _kept(channels: Sequence[str], aovs: Mapping[str, str]) -> list[str]:
    return [name for name in channels if name in RGB or name.rpartition(".")[0] in aovs]


def _camera_mover(sensor: Any, path: camera_path.CameraPath) -> Callable[[int], None]:
    """Return the function that moves the sensor to a frame's pose, in place."""
    parameters = mi.traverse(sensor)
    needed = ["to_world"] + (["x_fov"] if path.fovs is not None else [])
    for name in needed:
        if name not in parameters:
            raise UsageError(f"the camera path cannot move this sensor: it has no '{name}'")

    def move(frame: int) -> None:
        pose = path.pose(frame)
        parameters["to_world"] = mi.ScalarTransform4f().look_at(
            origin=pose.origin.tolist(), target=pose.target.tolist(), up=pose.up.tolist()
        )
        if pose.fov is not None:
            parameters["x_fov"] = pose.fov
        parameters.update()

    return move


def _report(writer: Writer, start: float) -> None:
    if writer.written:
        first, last = writer.written[0], writer.written[-1]
        names = f"{first}" if first == last else f"{first} ... {last}"
        seconds = time.perf_counter() - start
        print(f"{writer.frames} frames in {seconds:.1f} s: {names} ({len(writer.written)} files)")
