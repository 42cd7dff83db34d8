"""From the words of a command line to a Mitsuba variant, scene and integrator."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mitsuba as mi

from .. import scenes
from ..errors import UsageError, one_line

PREFERRED_VARIANTS = ("cuda_ad_rgb", "llvm_ad_rgb")


def usable_variants() -> list[str]:
    """Return the variants that `restir_pt` runs in: JIT-compiled and not polarized."""
    return [
        name
        for name in mi.variants()
        if not name.startswith("scalar") and not name.endswith("polarized")
    ]


def choose_variant(name: str | None) -> str:
    """
    Set the Mitsuba variant: the one asked for, the one already set, or the first that works.

    Raises
    ------
    UsageError
        The variant does not exist, cannot run `restir_pt`, or its back end does not start.
    """
    name = name or mi.variant()
    if name is not None and name not in usable_variants():
        raise UsageError(f"no variant '{name}' for restir_pt: use {', '.join(usable_variants())}")
    try:
        mi.set_variant(*([name] if name else PREFERRED_VARIANTS))
    except ImportError as error:
        raise UsageError(
            f"the variant {name or PREFERRED_VARIANTS[-1]} does not start: {one_line(error)} "
            "(see mitsuba-restir doctor)"
        ) from error
    return str(mi.variant())


def load_scene(
    source: str,
    definitions: Mapping[str, str],
    size: tuple[int, int] | None,
    keep_filter: bool = False,
    apart: bool = False,
) -> Any:
    """
    Load an embedded scene or an XML file.

    Parameters
    ----------
    source : str
        Name of an embedded scene, or path of an XML file.
    definitions : mapping
        Values for the file's ``<default>``s.
    size : (int, int) or None
        Width and height in pixels; None keeps the scene's own.
    keep_filter : bool
        Keep the film's reconstruction filter instead of a box.
    apart : bool
        Leave objects apart that Mitsuba would merge, so that each can be edited by its name.

    Returns
    -------
    mi.Scene

    Raises
    ------
    UsageError
        There is no such scene, the file is broken, or it lacks a definition; says which exist.
    """
    if source in scenes.names():
        if definitions:
            raise UsageError(f"argument -D: the embedded scene '{source}' has no definitions")
        return scenes.load(source, *size) if size else scenes.load(source)
    path = Path(source)
    if not path.is_file():
        names = ", ".join(scenes.names())
        raise UsageError(f"'{source}' is neither a scene file nor an embedded scene ({names})")
    _check_definitions(path, definitions)
    config = mi.parser.ParserConfig(mi.variant())
    config.merge_meshes = config.merge_equivalent = not apart
    return _load_file(config, path, definitions, size, keep_filter)


def _check_definitions(path: Path, definitions: Mapping[str, str]) -> None:
    """Refuse definitions that the file, or one that it includes, does not have."""
    names: list[str] = []
    pending, seen = [path], set()
    while pending:
        file = pending.pop()
        seen.add(file)
        try:
            root = ElementTree.parse(file).getroot()
        except (ElementTree.ParseError, OSError, UnicodeError, ValueError) as error:
            raise UsageError(f"{file} is not a scene file: {one_line(error)}") from error
        names += [node.get("name", "") for node in root.iter("default")]
        included = [path.parent / node.get("filename", "") for node in root.iter("include")]
        pending += [other for other in included if other.is_file() and other not in seen]
    unknown = sorted(set(definitions) - set(names))
    if unknown:
        has = f"it has {', '.join(dict.fromkeys(names))}" if names else "it has none"
        raise UsageError(f"argument -D: {path} has no definition '{unknown[0]}'; {has}")


def _load_file(
    config: Any,
    path: Path,
    definitions: Mapping[str, str],
    size: tuple[int, int] | None,
    keep_filter: bool,
) -> Any:
    outer = mi.file_resolver()
    resolver = mi.FileResolver(outer)
    resolver.prepend(str(path.parent.resolve()))
    mi.set_file_resolver(resolver)
    try:
        state = mi.parser.parse_file(config, str(path), **definitions)
        mi.parser.transform_all(config, state)
        _set_up_films(state, size, keep_filter)
        if config.merge_meshes:
            _leave_lights_apart(state)
        scene = mi.parser.instantiate(config, state)
    except (RuntimeError, ValueError, TypeError) as error:
        message = one_line(error).replace(f"At {path} ", "")
        raise UsageError(f"{path} cannot be loaded: {message}") from error
    finally:
        mi.set_file_resolver(outer)
    if not isinstance(scene, mi.Scene):
        raise UsageError(f"{path} holds no scene")
    return scene


def _set_up_films(state: Any, size: tuple[int, int] | None, keep_filter: bool) -> None:
    """Give every film the size asked for, a box filter and colour without alpha."""
    kinds = mi.ObjectType
    pixel_format = "luminance" if "mono" in mi.variant() else "rgb"
    for node in state.nodes:
        if node.type == kinds.Sensor and not _children(state, node.props, kinds.Film):
            film = {"type": "hdrfilm", "pixel_format": pixel_format, "rfilter": {"type": "box"}}
            shape = {"width": size[0], "height": size[1]} if size else {}
            node.props["film"] = mi.load_dict({**film, **shape})
        if node.type != kinds.Film:
            continue
        properties = node.props
        if properties.plugin_name() != "hdrfilm":
            kind = properties.plugin_name()
            raise ValueError(f"its film is a {kind}; only hdrfilm is supported")
        properties["pixel_format"] = pixel_format
        if size:
            for key in [key for key in properties.keys() if key.startswith("crop_")]:
                del properties[key]
            properties["width"], properties["height"] = size
        if not keep_filter:
            for key in _children(state, properties, kinds.ReconstructionFilter):
                del properties[key]
            properties["rfilter"] = mi.load_dict({"type": "box"})


def _leave_lights_apart(state: Any) -> None:
    """Take shapes that emit out of what Mitsuba merges, so that lights come in one order.

    No two of them would be merged, as each has an emitter of its own; but what is merged comes in
    the order of a hash of addresses, and the order of the lights decides what a seed renders. What
    the file itself merges stays as it is.
    """
    kinds, everything = mi.ObjectType, state.root.props
    # Mitsuba puts all objects of a scene into one that merges.
    for name in _children(state, everything, kinds.Shape):
        merged = state.nodes[everything[name].index()].props
        for key in _children(state, merged, kinds.Shape):
            shape = merged[key]
            if _children(state, state.nodes[shape.index()].props, kinds.Emitter):
                del merged[key]
                everything[f"_emitting_shape_{shape.index()}"] = shape


def _children(state: Any, properties: Any, kind: Any) -> list[str]:
    """Names of an object's children of a kind."""
    reference = mi.Properties.Type.ResolvedReference
    return [
        key
        for key in properties.keys()
        if properties.type(key) == reference and state.nodes[properties[key].index()].type == kind
    ]


def choose_sensor(scene: Any, index: int) -> Any:
    """
    Return one of the scene's sensors.

    Raises
    ------
    UsageError
        The scene has no such sensor.
    """
    sensors = scene.sensors()
    if not 0 <= index < len(sensors):
        raise UsageError(f"argument --sensor: the scene has {len(sensors)} sensors, not {index}")
    return sensors[index]


def make_integrator(kind: str, parameters: Mapping[str, Any]) -> Any:
    """
    Build an integrator.

    Raises
    ------
    UsageError
        The plugin refuses a parameter.
    """
    try:
        return mi.load_dict({"type": kind, **parameters})
    except (RuntimeError, ValueError, TypeError) as error:
        raise UsageError(one_line(error)) from error
