"""The shape of the house: imports go down only, functions have few parameters, modules are short.

The sources are read, never imported. Each rule has a control: a made-up source that breaks it.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "mitsuba_restir"

Sources = dict[PurePosixPath, str]
"""Text of each module, by its path in the package."""

COMMON = ("errors", "imageio", "cache", "arrays", "transforms", "curves")
"""Modules that all rooms may import."""

FACTS = ("llvm", "camera_path", "scene_files")
"""Modules that all rooms above the core may import."""

CORE = (
    "sampling",
    "paths",
    "shifts",
    "resampling",
    "neighbors",
    "mutations",
    "guiding",
    "passes",
    "integrators",
)
"""From the lowest floor to the highest."""

ABOVE = ("sequence", "still", "viewer", "studies", "cli")
"""What uses the core, from the lowest floor to the highest."""

STUDIES = ("config", "runs", "store", "measure", "report")
"""Rooms of the studies, from the lowest to the highest; modules beside them are free."""

BESIDE = ("scenes", "analysis")
"""Know nothing of the core, and nothing of each other."""

BELOW: dict[str, tuple[str, ...]] = {
    "errors": (),
    "imageio": ("errors",),
    "cache": ("errors",),
    "arrays": ("errors", "imageio"),
    "transforms": (),
    "curves": (),
    "llvm": (),
    "camera_path": COMMON,
    "scene_files": (*COMMON, "scenes"),
    **dict.fromkeys(BESIDE, COMMON),
    **{room: (*COMMON, *CORE[:i]) for i, room in enumerate(CORE)},
    # The viewer only once somebody asks for it.
    "__init__": ("errors", "llvm", "integrators", "viewer"),
    **{
        room: ("__init__", *COMMON, *FACTS, *BESIDE, *CORE, *ABOVE[:i])
        for i, room in enumerate(ABOVE)
    },
    "__main__": ("cli",),
}
"""What the modules of a room may import, beside those of the same room."""

MOST_LINES = 300
MOST_PARAMETERS = 6

PUBLIC = (("still/driver.py", "render"),)
"""Functions whose parameters are those that users were promised."""


@pytest.fixture(scope="module")
def sources() -> Sources:
    files = sorted(PACKAGE.rglob("*.py"))
    return {PurePosixPath(f.relative_to(PACKAGE).as_posix()): f.read_text("utf-8") for f in files}


def room_of(name: str) -> str:
    """Folder of a module ("passes.shade"), or the module itself where it is in none."""
    return name.split(".")[0] or "__init__"


def dotted(path: PurePosixPath) -> str:
    return ".".join(path.with_suffix("").parts).removesuffix("__init__").rstrip(".")


def imported(path: PurePosixPath, sources: Sources) -> set[str]:
    """Modules of the package that a module imports, wherever in its text."""
    known = {dotted(other) for other in sources}
    found = set()
    for node in ast.walk(ast.parse(sources[path])):
        if isinstance(node, ast.Import):
            names = [alias.name.split(".") for alias in node.names]
            found |= {".".join(name[1:]) for name in names if name[0] == PACKAGE.name}
        elif isinstance(node, ast.ImportFrom):
            base = [] if node.module is None else node.module.split(".")
            if node.level:
                base = [*path.parent.parts[: len(path.parent.parts) + 1 - node.level], *base]
            elif base[0] == PACKAGE.name:
                base = base[1:]
            else:
                continue
            # "from .folder import name" imports a module where there is one of that name.
            inside = [".".join([*base, alias.name]) for alias in node.names]
            found |= {name if name in known else ".".join(base) for name in inside}
    return found


def forbidden_imports(sources: Sources) -> Iterator[str]:
    """Arrows that go up or sideways."""
    for path in sources:
        room = room_of(dotted(path))
        if room not in BELOW:
            yield f"{path}: the room {room} has no place in this test"
            continue
        for name in sorted(imported(path, sources)):
            there = room_of(name)
            if there == room:
                allowed = _inside(path, name)
            else:
                allowed = there in BELOW[room]
            if not allowed:
                yield f"{path} imports {name or 'the package'}"


def _inside(path: PurePosixPath, name: str) -> bool:
    """Whether a module may import this one of its own room."""
    if path.parts[0] == "passes":
        return name in ("passes", dotted(path))
    if path.parts[0] == "studies":
        here, there = path.parts[1], [*name.split("."), ""][1]
        if here in STUDIES and there in STUDIES:
            return STUDIES.index(there) <= STUDIES.index(here)
    return True


def core_of(sources: Sources) -> Sources:
    """The core, and what is built as strictly as it."""
    return {path: text for path, text in sources.items() if path.parts[0] in (*CORE, "still")}


def long_modules(sources: Sources) -> Iterator[str]:
    for path, text in core_of(sources).items():
        lines = len(text.splitlines())
        if lines > MOST_LINES:
            yield f"{path} has {lines} lines"


def crowded_functions(sources: Sources) -> Iterator[str]:
    """Functions with too many parameters, not counting ``self`` and ``cls``."""
    for path, text in core_of(sources).items():
        if path.parts[0] == "sampling":
            continue
        tree = ast.parse(text)
        methods = {
            id(node) for c in ast.walk(tree) if isinstance(c, ast.ClassDef) for node in c.body
        }
        for node in ast.walk(tree):
            if not isinstance(node, ast.FunctionDef) or (str(path), node.name) in PUBLIC:
                continue
            a = node.args
            names = [
                x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg) if x
            ]
            if id(node) in methods and names[:1] in (["self"], ["cls"]):
                names = names[1:]
            if len(names) > MOST_PARAMETERS:
                yield f"{path}: {node.name} has {len(names)} parameters"


# ------------------------------ the package -----------------------------------------------------


def test_the_package_was_read(sources):
    """The rules would hold of nothing."""
    rooms = {path.parts[0] for path in sources}
    assert set(CORE) - {"guiding"} <= rooms
    assert "shifts.mapping" in imported(PurePosixPath("shifts/hybrid.py"), sources)


def test_imports_go_down(sources):
    assert list(forbidden_imports(sources)) == []


def test_modules_of_the_core_are_short(sources):
    assert list(long_modules(sources)) == []


def test_functions_of_the_core_have_few_parameters(sources):
    assert list(crowded_functions(sources)) == []


# ------------------------------ controls --------------------------------------------------------


def made_up(*modules: tuple[str, str]) -> Sources:
    return {PurePosixPath(path): text for path, text in modules}


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("sampling/masks.py", "from ..paths.grid import Grid"),
        ("paths/vertex.py", "def f():\n    from ..shifts import hybrid"),
        ("shifts/hybrid.py", "from ..resampling.reservoir import Reservoir"),
        ("resampling/pairwise.py", "from ..neighbors.similarity import similar"),
        ("neighbors/paired.py", "import mitsuba_restir.mutations.chain"),
        ("mutations/chain.py", "from mitsuba_restir.guiding import guide"),
        ("guiding/guide.py", "from .. import passes"),
        ("passes/shade.py", "from ..integrators.frame import Frame"),
        ("passes/shade.py", "from .initial import initial"),
        ("passes/shade.py", "from . import initial"),
        ("integrators/frame.py", "from ..studies.config import Study"),
        ("paths/vertex.py", "from ..analysis import metrics"),
        ("paths/vertex.py", "from .. import scenes"),
        ("scenes/court.py", "from ..sampling import masks"),
        ("scenes/court.py", "from ..analysis import images"),
        ("analysis/bias.py", "from ..sampling.georgiev import SIGMA_I"),
        ("analysis/bias.py", "from ..studies import results"),
        ("studies/runner.py", "from ..cli import loading"),
        ("studies/config/size.py", "from ..report.page import page"),
        ("studies/store/folder.py", "from .. import measure"),
        ("still/plan.py", "from ..studies.config import Study"),
        ("errors.py", "from .imageio import Image"),
        ("attic/old.py", ""),
    ],
)
def test_control_imports(path, text):
    others = ("passes/initial.py", "studies/measure/__init__.py", "studies/report/page.py")
    sources = made_up(*((other, "") for other in others), (path, text))
    assert len(list(forbidden_imports(sources))) == 1


@pytest.mark.parametrize(
    ("path", "text"),
    [
        (
            "still/driver.py",
            "from ..scene_files import digest\nfrom ..integrators.state import State",
        ),
        ("shifts/hybrid.py", "from .replay import replay\nfrom ..paths.record import Kind"),
        ("passes/shade.py", "from ..mutations.chain import Mutated\nimport mitsuba as mi"),
        ("integrators/__init__.py", "from . import restir_pt"),
        ("studies/report/page.py", "from ..config import Study\nfrom ...analysis import metrics"),
        ("cli/compare.py", "from .. import __version__, imageio\nfrom ..studies import results"),
    ],
)
def test_control_imports_that_go_down(path, text):
    assert list(forbidden_imports(made_up((path, text)))) == []


def test_control_long_module():
    sources = made_up(("shifts/a.py", "x = 1\n" * 300), ("shifts/b.py", "x = 1\n" * 301))
    assert list(long_modules(sources)) == ["shifts/b.py has 301 lines"]


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("def f(a, b, c, d, e, f): ...", 0),
        ("def f(a, b, c, d, e, f, g): ...", 1),
        ("def f(self, a, b, c, d, e, f): ...", 1),
        ("def f(a, b, /, c, d, *e, f, **g): ...", 1),
        ("class C:\n    def f(self, a, b, c, d, e, f): ...", 0),
        ("class C:\n    def f(self, a, b, c, d, e, f, g): ...", 1),
        ("class C:\n    @staticmethod\n    def f(a, b, c, d, e, f, g): ...", 1),
        ("def f():\n    def g(a, b, c, d, e, f, g): ...", 1),
    ],
)
def test_control_parameters(text, count):
    assert len(list(crowded_functions(made_up(("passes/made_up.py", text))))) == count
