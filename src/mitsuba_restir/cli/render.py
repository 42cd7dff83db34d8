"""``mitsuba-restir render``: a sequence of frames, to files."""

from __future__ import annotations

import argparse
import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from .. import __version__, sequence
from ..analysis.denoise import GUIDES
from ..camera_path import DEFAULT_FPS
from ..errors import UsageError
from ..imageio import RGB, Image
from ..integrators.images import asking_for
from ..passes.shade import AOVS
from ..scene_files import digest
from ..sequence import Animation, Shot, video
from ..sequence.shot import seed_from
from . import denoising, loading, output, parts
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


def add_spp_argument(parser: argparse.ArgumentParser) -> None:
    """Add what every command that renders frames of a history accepts."""
    parser.add_argument(
        "--spp",
        metavar="N",
        type=integer(1, MAX_SPP),
        default=1,
        help="initial candidate paths per pixel and frame (1)",
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
        f"numbers; a name ending in {', '.join(video.SUFFIXES)} is a film; existing files are "
        "replaced",
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
    add_spp_argument(parser)
    parser.add_argument(
        "--animate",
        "--camera-path",
        metavar="FILE",
        type=Path,
        help="keyframes of the camera and of what moves in the scene, in JSON or TOML",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="keep the finished frames of an animation or a film, and go on from there",
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
    animation = sequence.load(options.animate) if options.animate else None
    schedule = _schedule(options, animation)
    target = _target(options, schedule, animation)

    variant = loading.choose_variant(options.variant)
    guides = _guides(aovs) if options.denoise else {}
    wanted = {**aovs, **{name: kind for kind, name in guides.items()}}
    if wanted:
        parameters["aovs"] = asking_for(wanted)
    edits = animation is not None and bool(animation.tracks)
    if edits:
        parameters = {"retrace_history": True, **parameters}
    integrator = loading.make_integrator("restir_pt", parameters)
    scene = loading.load_scene(
        options.scene, definitions, options.resolution, options.keep_filter, apart=edits
    )
    sensor = loading.choose_sensor(scene, options.sensor)
    channels = [*RGB, *integrator.aov_names()]
    update = None if animation is None else animation.bind(scene, sensor)
    extras = ["", DENOISED] if options.denoise else [""]
    output.prepare_folder(target.stem.parent, f"{target.name(MAX_FRAMES - 1, extras[-1]).name}.exr")

    metadata = {
        "mitsuba-restir": __version__,
        "scene": options.scene,
        "variant": variant,
        "spp": str(options.spp),
        "seed": str(options.seed),
        "parameters": " ".join(f"{name}={value}" for name, value in parameters.items()),
    }
    if animation is not None or isinstance(target, parts.Film):
        settings = {**metadata, **_made_of(options, tuple(sensor.film().crop_size()))}
        schedule = _from(schedule, parts.begin(target, settings, options.resume, extras))
    writer = Writer(target, channels, _kept(channels, aovs), guides, options.average, metadata)
    first = schedule.start - schedule.warmup
    shot = Shot(
        scene, sensor, integrator, update, options.spp, seed_from(options.seed, max(first, 0))
    )

    def render_frame(frame: int) -> Image:
        return shot.image(max(frame, 0))

    try:
        for frame, image in run_frames(render_frame, schedule):
            writer.add(frame, image)
    finally:
        with held():
            writer.finish(schedule.frames)
            _report(writer, start)
    return 0


def _schedule(options: argparse.Namespace, animation: Animation | None) -> Schedule:
    frames = options.frames
    if frames is None and animation is not None:
        frames = animation.length
    if frames is None and options.time_budget is None:
        frames = 1
    if frames is not None and frames > MAX_FRAMES:
        raise UsageError(f"the animation has {frames} frames, more than {MAX_FRAMES}")
    if animation is not None:
        try:
            animation.check(frames or MAX_FRAMES)
        except UsageError as error:
            raise UsageError(f"argument --animate: {error}") from error
    return Schedule(frames, options.warmup, options.time_budget)


def _from(schedule: Schedule, start: int) -> Schedule:
    """The schedule from a frame on, with a warm-up before it."""
    if start == 0:
        return schedule
    if schedule.frames is not None and start >= schedule.frames:
        return replace(schedule, start=schedule.frames, warmup=0)
    begin = max(start - max(sequence.WARMUP, schedule.warmup), -schedule.warmup)
    return replace(schedule, start=start, warmup=start - begin)


def _target(
    options: argparse.Namespace, schedule: Schedule, animation: Animation | None
) -> parts.Target:
    """Where the pictures go, or the film."""
    path = Path(options.output or "")
    film = path.suffix.lower() in video.SUFFIXES
    if options.resume and (options.average or not (film or animation)):
        raise UsageError("argument --resume: needs --animate or a film, and no --average")
    if film and options.average:
        raise UsageError("argument --average: makes one picture, which is no film")
    if not film:
        numbered = not options.average and schedule.frames != 1
        return output.plan(options.output, options.scene, numbered)
    video.require(path.suffix.lower())
    if path.is_dir():
        raise UsageError(f"argument -o: '{path}' is a folder")
    fps = animation.fps if animation is not None else DEFAULT_FPS
    return parts.Film(path, fps, DENOISED if options.denoise else "")


def _made_of(options: argparse.Namespace, size: tuple[int, ...]) -> dict[str, str]:
    """What frames depend on beside what their metadata say."""
    found = {
        "scene file": digest(options.scene),
        "definitions": str(sorted(as_dict(options.definitions, "-D").items())),
        "sensor": str(options.sensor),
        "size": "x".join(map(str, size)),
        "denoised": str(options.denoise),
    }
    if options.animate:
        found["animation"] = hashlib.sha256(options.animate.read_bytes()).hexdigest()
    return found


def _guides(aovs: Mapping[str, str]) -> dict[str, str]:
    """Name of an AOV of each type that guides the denoiser, taken from those asked for or new."""
    names = {kind: name for name, kind in aovs.items()}
    return {kind: names.get(kind, f"denoiser_{kind}") for kind in GUIDES}


def _kept(channels: Sequence[str], aovs: Mapping[str, str]) -> list[str]:
    return [name for name in channels if name in RGB or name.rpartition(".")[0] in aovs]


def _report(writer: Writer, start: float) -> None:
    if writer.written:
        first, last = writer.written[0], writer.written[-1]
        names = f"{first}" if first == last else f"{first} ... {last}"
        seconds = time.perf_counter() - start
        print(f"{writer.frames} frames in {seconds:.1f} s: {names} ({len(writer.written)} files)")
