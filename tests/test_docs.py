"""The site and what is released: no warnings, links that lead somewhere, nothing unsaid."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

import mitsuba as mi
import pytest
import yaml

import mitsuba_restir
from mitsuba_restir.cli import build_parser
from mitsuba_restir.integrators.parameters import PARAMETERS

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

HERE = Path(__file__).resolve().parents[1]
DOCS = HERE / "docs"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.md"))
MOST_BYTES = 300_000

PUBLIC = (
    "mitsuba_restir",
    "mitsuba_restir.scenes",
    "mitsuba_restir.still",
    "mitsuba_restir.studies",
    *(
        f"mitsuba_restir.analysis.{name}"
        for name in (
            "bias",
            "covariance",
            "covariance_images",
            "denoise",
            "duplication",
            "images",
            "intervals",
            "metrics",
            "pixel_bias",
            "spectrum",
        )
    ),
    "mitsuba_restir.errors",
)
"""Modules whose ``__all__`` is public."""

# ------------------------------ the site --------------------------------------------------------


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site; warnings are errors."""
    for module in ("sphinx", "furo", "myst_parser", "sphinxcontrib.bibtex", "sphinx_copybutton"):
        pytest.importorskip(module, reason="the site is tested where the extra 'docs' is installed")
    place = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    result = subprocess.run([*command, DOCS, place], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr[-3000:]
    assert result.stderr.strip() == ""
    return place


class Page(HTMLParser):
    """What a page offers, and what it points to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.ids |= {value for key in ("id", "name") if (value := given.get(key))}
        self.links |= {value for key in ("href", "src") if (value := given.get(key))}


def broken_links(folder: Path) -> Iterator[str]:
    """Links within a folder of pages that lead nowhere."""
    pages = {path: Page(path.read_text("utf-8")) for path in folder.rglob("*.html")}
    for path, page in pages.items():
        for link in sorted(page.links):
            address, anchor = urldefrag(link)
            if re.match(r"[a-z]+:|//", address):
                continue
            target = (path.parent / unquote(address.partition("?")[0])).resolve()
            target = path.resolve() if not address else target
            if not target.exists():
                yield f"{path.name}: {link}"
            elif anchor and target in pages and unquote(anchor) not in pages[target].ids:
                yield f"{path.name}: no place {link}"


def test_the_site_is_built_and_its_links_lead_somewhere(site):
    assert len(list(site.glob("*.html"))) > 15
    assert list(broken_links(site)) == []


def test_control_links(tmp_path):
    (tmp_path / "a.html").write_text('<a id="x" href="b.html#y"></a><img src="c.png"><a href="#x">')
    (tmp_path / "b.html").write_text('<a id="z" href="https://example.org/">')
    assert list(broken_links(tmp_path)) == ["a.html: no place b.html#y", "a.html: c.png"]


def test_every_parameter_is_on_the_page_of_the_plugin(site):
    page = Page((site / "plugin.html").read_text("utf-8"))
    assert {f"parameter-{name}" for name in PARAMETERS} <= page.ids


def test_every_option_is_on_the_page_of_the_command_line(site):
    text = (site / "command_line.html").read_text("utf-8")
    (commands,) = (a for a in build_parser()._actions if a.dest == "command")
    for name, command in commands.choices.items():
        section = text.partition(f'id="command-{name}"')[2].partition('id="command-')[0]
        options = {word for action in command._actions for word in action.option_strings}
        missing = {word for word in options - {"-h", "--help"} if f">{word}<" not in section}
        assert not missing, f"{name}: {missing}"


# ------------------------------ public names ----------------------------------------------------


def public_names() -> list[str]:
    return [
        f"{module}.{name}"
        for module in PUBLIC
        for name in sorted(importlib.import_module(module).__all__)
    ]


def undocumented(owner: object, name: str) -> Iterator[str]:
    """What of a public name has no docstring; of a class, its own public methods too."""
    if not (inspect.isclass(owner) or callable(owner)):
        return
    if not inspect.getdoc(owner):
        yield name
    if inspect.isclass(owner):
        for key, member in vars(owner).items():
            kinds = (property, staticmethod, classmethod)
            if not key.startswith("_") and (
                inspect.isfunction(member) or isinstance(member, kinds)
            ):
                if not inspect.getdoc(getattr(member, "__func__", member)):
                    yield f"{name}.{key}"


def test_the_manifest_has_all_that_is_public():
    """A public name that comes or goes is a line of the manifest, and of the changelog."""
    assert (DOCS / "MANIFEST.txt").read_text("utf-8").split() == public_names()


def test_all_that_is_public_is_documented(rgb):
    modules = {module: importlib.import_module(module) for module in PUBLIC}
    missing = [module for module, found in modules.items() if not found.__doc__]
    for name in public_names():
        module, _, own = name.rpartition(".")
        missing += undocumented(getattr(modules[module], own), name)
    integrator = type(mi.load_dict({"type": "restir_pt"}))
    missing += undocumented(integrator, "restir_pt")
    assert missing == []


def test_control_undocumented():
    class Silent:
        """Says what it is."""

        def method(self) -> None: ...

    assert list(undocumented(Silent, "Silent")) == ["Silent.method"]
    assert list(undocumented(lambda: None, "nothing")) == ["nothing"]


def test_all_that_is_public_is_on_the_site(site):
    page = Page((site / "python.html").read_text("utf-8"))
    assert [name for name in public_names() if name not in page.ids] == []


# ------------------------------ what is released ------------------------------------------------


def test_links_of_the_readme_work_anywhere():
    """PyPI shows it without the files beside it; those that it names have to be in the checkout."""
    text = (HERE / "README.md").read_text("utf-8")
    links = re.findall(r"\]\(([^)\s]+)\)", text)
    assert [link for link in links if not link.startswith("https://")] == []
    repository = project()["urls"]["Repository"]
    raw = repository.replace("github.com", "raw.githubusercontent.com") + "/main/"
    own = [link for link in links if repository.split("/")[-1] in link]
    assert len(own) > 10
    for link in own:
        path = urldefrag(link)[0].removeprefix(f"{repository}/blob/main/").removeprefix(raw)
        assert (HERE / path).is_file(), link


def test_the_citation_is_current():
    citation = yaml.safe_load((HERE / "CITATION.cff").read_text("utf-8"))
    assert citation["version"] == mitsuba_restir.__version__
    assert citation["license"] == project()["license"]
    assert citation["repository-code"] == project()["urls"]["Repository"]
    assert f"## {citation['version']}" in (HERE / "CHANGELOG.md").read_text("utf-8")


def test_a_bug_report_asks_for_doctor():
    template = HERE / ".github" / "ISSUE_TEMPLATE" / "bug_report.yml"
    assert "mitsuba-restir doctor" in template.read_text("utf-8")
    assert all(
        field["type"] == "textarea" for field in yaml.safe_load(template.read_text())["body"]
    )


def project() -> dict:
    return tomllib.loads((HERE / "pyproject.toml").read_text("utf-8"))["project"]


# ------------------------------ notebooks and pictures ------------------------------------------


def test_pictures_are_small():
    large = {p.name: p.stat().st_size for p in (DOCS / "figures").iterdir()}
    assert large
    assert {name: size for name, size in large.items() if size > MOST_BYTES} == {}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_a_notebook_draws_is_kept(path):
    """`make figures` was run after a cell got its name."""
    names = re.findall(r"^:name: (\S+)$", path.read_text("utf-8"), re.M)
    assert names
    kept = {file.stem for file in (DOCS / "figures").glob("*.png")}
    assert {f"{path.stem}-{name}" for name in names} <= kept


@pytest.mark.notebooks
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook(path):
    for module in ("jupytext", "nbclient", "ipykernel", "matplotlib"):
        pytest.importorskip(module, reason="notebooks are run where the extra 'docs' is installed")
    from run_notebooks import executed, outputs

    found = outputs(executed(path))
    names = re.findall(r"^:name: (\S+)$", path.read_text("utf-8"), re.M)
    assert all(found[name][1] for name in names)
