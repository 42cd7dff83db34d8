"""Scenes that are edited, shapes that get other primitives, and frames from several threads."""

from __future__ import annotations

import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from support import edits

from mitsuba_restir import still
from mitsuba_restir.integrators import flat, recording
from mitsuba_restir.integrators.scene_watch import SceneWatch
from mitsuba_restir.still.frames import Frames, Subject
from mitsuba_restir.still.plan import Plan

# --------------------------------- edits --------------------------------------------------------

QUICK = {
    "shape cube": ["thing.vertex_positions", "thing.faces"],
    "bsdf bumpmap": ["thing.bsdf.scale"],
    "bsdf plastic": ["thing.bsdf.eta"],
    "shape shapegroup": ["thing.box.vertex_positions"],
    "shape sdfgrid": ["thing.grid"],
    "texture mesh_attribute": ["thing.vertex_color"],
    "emitter point": ["thing.position", "thing.intensity.value"],
    "emitter rectangle": ["thing.emitter.radiance.value"],
    "emitter constant": ["thing.radiance.value"],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_an_edited_scene_is_like_a_new_one(rgb, name):
    """Bit by bit, after several edits in a row: a stale address is often right every other time."""
    assert edits.stale_edits(edits.things()[name], 4, QUICK[name]) == {
        key: [] for key in QUICK[name]
    }


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:.* cannot be re-projected")
def test_every_parameter_of_every_plugin(rgb):
    tried, stale = 0, {}
    for name, description in edits.things().items():
        found = edits.stale_edits(description, 4)
        tried += len(found)
        stale |= {f"{name}: {key}": steps for key, steps in found.items() if steps}
    print(f"{len(edits.things())} plugins, {tried} parameters")
    assert not stale
    assert tried > 230


@pytest.mark.slow
def test_edits_without_a_reset(rgb):
    """The history stays, and every frame is what it is if nothing is recorded."""
    sequences = []
    for recorded in (True, False):
        with dr.scoped_set_flag(dr.JitFlag.KernelFreezing, recorded):
            scene = mi.load_dict(edits.things()["bsdf bumpmap"])
            parameters = mi.traverse(scene)
            renderer = mi.load_dict(edits.RENDERER)
            sequence = []
            for step in range(5):
                parameters["thing.bsdf.scale"] = 0.2 + 0.1 * step
                parameters.update()
                sequence.append(edits.frames(renderer, scene))
                assert step == 0 or renderer.statistics()["matched"] > 0.3
            sequences.append(np.stack(sequence))
    np.testing.assert_array_equal(*sequences)


@pytest.mark.slow
def test_a_plugin_in_python(rgb):
    class Grey(mi.BSDF):
        def __init__(self, properties: mi.Properties) -> None:
            super().__init__(properties)
            self.albedo = 0.2
            self.m_components = [mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide]
            self.m_flags = self.m_components[0]

        def sample(self, context, si, sample1, sample2, active=True):
            bs = dr.zeros(mi.BSDFSample3f)
            bs.wo = mi.warp.square_to_cosine_hemisphere(sample2)
            bs.pdf = mi.warp.square_to_cosine_hemisphere_pdf(bs.wo)
            bs.eta = 1.0
            bs.sampled_type = mi.UInt32(+mi.BSDFFlags.DiffuseReflection)
            return bs, mi.Color3f(self.albedo) & (active & (si.wi.z > 0) & (bs.pdf > 0))

        def eval(self, context, si, wo, active=True):
            lit = active & (si.wi.z > 0) & (wo.z > 0)
            return mi.Color3f(self.albedo * wo.z / dr.pi) & lit

        def pdf(self, context, si, wo, active=True):
            lit = active & (si.wi.z > 0) & (wo.z > 0)
            return dr.select(lit, mi.warp.square_to_cosine_hemisphere_pdf(wo), 0)

        def eval_pdf(self, context, si, wo, active=True):
            return self.eval(context, si, wo, active), self.pdf(context, si, wo, active)

    mi.register_bsdf("grey", Grey)
    scene = mi.load_dict(edits.scene_with({"type": "sphere", "bsdf": {"type": "grey"}}))
    (bsdf,) = {shape.bsdf() for shape in scene.shapes() if isinstance(shape.bsdf(), Grey)}
    renderer = mi.load_dict(edits.RENDERER)
    for albedo in (0.2, 0.4, 0.6):
        bsdf.albedo = albedo
        renderer.reset()
        np.testing.assert_array_equal(
            edits.frames(renderer, scene), edits.untouched(edits.RENDERER, scene)
        )


@pytest.mark.slow
def test_changes_that_are_no_parameters(rgb):
    """Another BSDF, and after a reset attributes that a texture reads."""
    scene = mi.load_dict(edits.things()["texture mesh_attribute"])
    mesh = next(shape for shape in scene.shapes() if shape.has_mesh_attributes())
    renderer = mi.load_dict(edits.RENDERER)
    edits.frames(renderer, scene)
    before = mesh.bsdf()
    for change in (
        lambda: mesh.set_bsdf(mi.load_dict({"type": "roughconductor", "alpha": 0.3})),
        lambda: mesh.set_bsdf(before),
        lambda: (
            mesh.remove_attribute("vertex_color"),
            mesh.add_attribute("vertex_color", 3, [0.7, 0.2, 0.2] * 3),
        ),
    ):
        change()
        renderer.reset()
        np.testing.assert_array_equal(
            edits.frames(renderer, scene), edits.untouched(edits.RENDERER, scene)
        )


def test_a_watch_sees_nothing_where_nothing_is_edited(rgb):
    scene = mi.load_dict(edits.things()["shape shapegroup"])
    watch = SceneWatch(scene)
    renderer = mi.load_dict(edits.RENDERER)
    camera = mi.traverse(scene.sensors()[0])
    for step in range(3):
        camera["to_world"] = mi.Transform4f().look_at([0.1 * step, 2, 3], [0, 0, 0], [0, 1, 0])
        camera.update()
        edits.frames(renderer, scene)
        assert watch.look(thorough=True) is None


def test_only_edits_of_primitives_reshape(rgb):
    scene = mi.load_dict(edits.things()["shape cube"])
    (cube,) = (shape for shape in scene.shapes() if shape.primitive_count() == 12)
    watch, parameters = SceneWatch(scene), mi.traverse(scene)
    parameters["thing.vertex_positions"] *= 0.9
    parameters.update()
    assert watch.look(thorough=False).reshaped == ()
    parameters["thing.faces"] = mi.UInt32(np.array(parameters["thing.faces"])[3:])
    parameters.update()
    assert watch.look(thorough=False).reshaped == (cube,)
    assert watch.look(thorough=False) is None


def test_recordings_follow_lights_and_places_alone(rgb):
    scene = mi.load_dict(edits.things()["bsdf plastic"])
    watch, parameters = SceneWatch(scene), mi.traverse(scene)
    for names, replayable in (
        (["lamp.emitter.radiance.value"], True),
        (["lamp.emitter.radiance.value", "sky.radiance.value"], True),
        (["lamp.emitter.radiance.value", "thing.bsdf.eta"], False),
        (["thing.bsdf.diffuse_reflectance.value"], False),
        (["thing.to_world", "lamp.to_world", "sky.radiance.value"], True),
        (["thing.to_world", "thing.bsdf.eta"], False),
    ):
        for name in names:
            parameters[name] = edits.edited(name.split(".")[-1], parameters[name], 1)
        parameters.update()
        assert watch.look(thorough=False).replayable is replayable, names


def test_recordings_do_not_follow_a_mesh(rgb):
    """They would show it where it was, as soon as memory is used again."""
    scene = mi.load_dict(edits.things()["shape cube"])
    watch, parameters = SceneWatch(scene), mi.traverse(scene)
    moved = edits.edited("vertex_positions", parameters["thing.vertex_positions"], 1)
    parameters["thing.vertex_positions"] = moved
    parameters.update()
    assert not watch.look(thorough=False).replayable


def test_watching_many_shapes_costs_little(rgb):
    """Half a millisecond for a thousand shapes (the fastest look of many: others use the CPU)."""
    spheres = {
        f"sphere_{i}": {"type": "sphere", "center": [i, 0, 0], "radius": 0.3} for i in range(1000)
    }
    watch = SceneWatch(mi.load_dict({"type": "scene", **spheres}))
    times = []
    for _ in range(50):
        start = time.perf_counter()
        assert watch.look(thorough=False) is None
        times.append(time.perf_counter() - start)
    assert min(times) < 5e-4


@pytest.mark.slow
def test_edits_cost_no_memory_and_raise_no_warning(rgb, capfd):
    scene = mi.load_dict(edits.things()["bsdf plastic"])
    parameters = mi.traverse(scene)
    renderer = mi.load_dict(edits.RENDERER)

    def peak(count: int) -> int:
        dr.detail.malloc_clear_statistics()
        for step in range(count):
            parameters["thing.bsdf.diffuse_reflectance.value"] = mi.Color3f(0.02 * (step + 1))
            parameters.update()
            edits.frames(renderer, scene)
        return dr.detail.malloc_watermark(dr.JitBackend.LLVM)

    first = peak(6)
    assert peak(14) <= first
    assert "recorded" not in "".join(capfd.readouterr())


# --------------------------------- recordings ---------------------------------------------------


def test_flat_lists_and_back():
    value = ([1, (2, None)], recording._Sealed, flat.Structure)
    leaves: list[Any] = []
    structure = flat.flatten(value, leaves)
    assert leaves == [1, 2, None, recording._Sealed, flat.Structure]
    assert flat.unflatten(structure, iter(leaves)) == value


def test_no_python_runs_while_dr_jit_is_locked(rgb):
    """Dr.Jit replays under its lock: Python could pass to a thread that waits for it."""
    scene = mi.load_dict(edits.things()["bsdf diffuse"])
    renderer = mi.load_dict(edits.RENDERER)
    edits.frames(renderer, scene, 3)
    inside = []

    def watch(frame: Any, event: str, _: Any) -> None:
        caller = frame.f_back
        if event == "call" and caller is not None and caller.f_code.co_name == "__call__":
            if Path(caller.f_code.co_filename).parent.name == "drjit":
                inside.append(frame.f_code.co_name)

    sys.setprofile(watch)
    try:
        edits.frames(renderer, scene)
    finally:
        sys.setprofile(None)
    assert set(inside) == {"capture_closure"}  # before the lock is taken


# --------------------------------- other primitives ---------------------------------------------


def child(program: str, *arguments: Any, timeout: float = 240) -> str:
    """Run a program that may crash or hang; it has the tests' helpers."""
    preamble = """
        import sys, threading
        import mitsuba_restir
        import drjit as dr, mitsuba as mi, numpy as np
        mi.set_variant("llvm_ad_rgb")
        from support import edits
    """
    source = textwrap.dedent(preamble) + textwrap.dedent(program)
    run = subprocess.run(
        [sys.executable, "-c", source, *map(str, arguments)],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert run.returncode == 0, (run.returncode, run.stdout, run.stderr[-2000:])
    return run.stdout


RESHAPED = """
    import zoo
    parameters = eval(sys.argv[1])
    mesh = zoo._sphere_mesh("thing", True, rows=100, columns=200)
    mesh.write_ply(sys.argv[3])
    plugin = {"type": "ply", "filename": sys.argv[3], "face_normals": True}
    others = {}
    if sys.argv[2] == "True":
        plugin = {"type": "shapegroup", "mesh": plugin}
        others = {"instance": {"type": "instance", "group": {"type": "ref", "id": "thing"}}}
    scene = mi.load_dict(edits.scene_with(plugin, **others))
    renderer = mi.load_dict({"type": "restir_pt", "max_depth": 5, **parameters})
    scene_parameters = mi.traverse(scene)
    key = next(key for key in scene_parameters.keys() if key.endswith("faces"))
    faces = np.array(scene_parameters[key])
    dropped = []
    for edit, count in enumerate((len(faces), 12, len(faces), 3)):
        scene_parameters[key] = mi.UInt32(faces[-count:])
        scene_parameters.update()
        for frame in range(3):
            image = edits.frames(renderer, scene, 1)
            assert np.isfinite(image).all()
            statistics = renderer.statistics()
            assert ("dropped" in statistics) == (frame == 0 and edit > 0)
            if "dropped" in statistics:
                dropped.append(statistics["dropped"])
                assert statistics["matched"] > 0.2
    print(*dropped)
"""


@pytest.mark.slow
@pytest.mark.parametrize("instanced", [False, True], ids=["shape", "instance"])
@pytest.mark.parametrize(
    "parameters",
    [{}, {"retrace_history": True}, {"mutations": 1}],
    ids=["plain", "retrace", "mutations"],
)
def test_a_mesh_with_fewer_triangles(rgb, parameters, instanced, tmp_path):
    """Where the history used the mesh it is dropped, and says so; elsewhere it stays."""
    shares = [
        float(word)
        for word in child(RESHAPED, parameters, instanced, tmp_path / "mesh.ply").split()
    ]
    large, small = (shares[0], shares[2]), shares[1]
    assert all(0.1 < share < 0.9 for share in large)
    assert small < min(large)


# --------------------------------- threads ------------------------------------------------------


def test_a_scene_is_looked_at_in_its_turn(rgb):
    """Replays crash where another thread is the first to look at an object of any scene."""

    class Watched:
        """Anything of a scene, which says that it was looked at."""

        def __init__(self) -> None:
            self.looked = threading.Event()

        def __getattr__(self, name: str) -> Any:
            self.looked.set()
            raise LookupError(name)

    renderer = mi.load_dict(edits.RENDERER)
    plan = Plan("", 1, {"spatial": False})
    looks = (
        lambda thing: renderer.render(thing),
        lambda thing: renderer.prepare(thing, thing),
        lambda thing: Subject(thing, thing, 0).lit,
        lambda thing: Frames(Subject(thing, thing, 0), plan),
        lambda thing: still.render(thing, frames=2),
    )
    for look in looks:
        thing, begun = Watched(), threading.Event()

        def in_turn(look: Any = look, thing: Any = thing, begun: Any = begun) -> None:
            begun.set()
            look(thing)

        with ThreadPoolExecutor(1) as pool:
            with recording.frame_alone():
                done = pool.submit(in_turn)
                assert begun.wait(60)
                assert not thing.looked.wait(0.3)
            with pytest.raises(LookupError):
                done.result()
        assert thing.looked.is_set()


THREADS = """
    sys.setswitchinterval(1e-4)
    what = sys.argv[1]
    description = edits.things()["bsdf plastic"]
    scenes = [mi.load_dict(description) for _ in range(2)]
    renderers = [mi.load_dict(edits.RENDERER) for _ in range(2)]
    if what == "one integrator":
        renderers[1], scenes[1] = renderers[0], scenes[0]
    if what == "one scene":
        scenes[1] = scenes[0]
    errors, images = [], {0: [], 1: []}

    def render(index):
        for seed in range(8):
            image = renderers[index].render(scenes[index], seed=seed, spp=1)
            images[index].append(np.array(image))

    def calculate(index):
        for i in range(300):
            assert dr.sum(mi.Float(np.ones(100, np.float32)) * (i + 1))[0] > 0

    def caught(function, index):
        try:
            function(index)
        except BaseException as error:
            errors.append(repr(error))

    other = calculate if what == "calculate" else render
    threads = [threading.Thread(target=caught, args=job) for job in ((render, 0), (other, 1))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not errors, errors
    if what != "one integrator":
        expected = edits.frames(mi.load_dict(edits.RENDERER), scenes[0], 8)
        for index in (0, 1):
            if images[index]:
                np.testing.assert_array_equal(images[index], expected)
"""


NEW_SCENES = """
    sys.setswitchinterval(1e-4)
    description = edits.things()["bsdf plastic"]
    scenes = [mi.load_dict(description) for _ in range(61)]
    renderers = [mi.load_dict(edits.RENDERER) for _ in range(2)]
    edits.frames(renderers[0], scenes[0], 3)
    errors, done = [], threading.Event()

    def render_on():
        try:
            while not done.is_set():
                renderers[0].render(scenes[0], spp=1)
        except BaseException as error:
            errors.append(repr(error))

    thread = threading.Thread(target=render_on)
    thread.start()
    for scene in scenes[1:]:
        try:
            renderers[1].render(scene, seed=-1)  # refused, once the scene has been looked at
        except ValueError:
            pass
    done.set()
    thread.join()
    assert not errors, errors
"""


@pytest.mark.slow
def test_new_scenes_beside_a_thread_that_renders(rgb):
    """Every one is new to Python, too."""
    child(NEW_SCENES)


@pytest.mark.slow
@pytest.mark.parametrize("repeat", range(3))
@pytest.mark.parametrize("what", ["two integrators", "one integrator", "one scene", "calculate"])
def test_threads(rgb, what, repeat):
    """Two threads that render, or one beside another that calculates: no hang, no wrong image."""
    child(THREADS, what, timeout=120)
