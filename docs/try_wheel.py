"""Build wheel and sdist, check them, and try the wheel as a new user does.

    python docs/try_wheel.py    # or: make dist

The wheel is installed into an environment of its own, in a folder outside of the checkout; there
``doctor`` has to be content, and ``still cornell`` has to render.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
import venv
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
DIST = HERE / "dist"
MOST_KILOBYTES = 1000
FOREIGN = ("tests/", "benchmarks/", "docs/")


def run(*words: str | Path, **options: object) -> None:
    """Run a command, and end where it fails."""
    print("$", *words, flush=True)
    subprocess.run([str(word) for word in words], check=True, **options)  # type: ignore[call-overload]


def built() -> Path:
    """Build both, check their descriptions, and return the wheel."""
    shutil.rmtree(DIST, ignore_errors=True)
    run(sys.executable, "-m", "build", "--outdir", DIST, HERE)
    run(sys.executable, "-m", "twine", "check", "--strict", *DIST.iterdir())
    (wheel,) = DIST.glob("*.whl")
    return wheel


def checked(wheel: Path) -> None:
    """
    Look at what is in it.

    Raises
    ------
    SystemExit
        It is too large, or holds what is not for users.
    """
    kilobytes = wheel.stat().st_size / 1000
    names = zipfile.ZipFile(wheel).namelist()
    print(f"{wheel.name}: {kilobytes:.0f} kB, {len(names)} files")
    foreign = [name for name in names if name.startswith(FOREIGN)]
    if foreign or kilobytes > MOST_KILOBYTES:
        raise SystemExit(f"too much in the wheel: {', '.join(foreign) or f'{kilobytes:.0f} kB'}")


def tried(wheel: Path, folder: Path) -> None:
    """Install it and render with it, in an empty folder."""
    # What the checkout's shell has set must not help.
    clean = {
        k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "MITSUBA", "DRJIT"))
    }
    start = time.perf_counter()
    venv.create(folder / "env", with_pip=True)
    programs = folder / "env" / ("Scripts" if sys.platform == "win32" else "bin")
    here = {"cwd": folder, "env": clean}
    run(programs / "python", "-m", "pip", "install", "--quiet", wheel, **here)
    installed = time.perf_counter()
    run(programs / "mitsuba-restir", "still", "cornell", **here)
    done = time.perf_counter()
    run(programs / "mitsuba-restir", "doctor", **here)
    pictures = sorted(path.name for path in folder.rglob("*.png") if "env" not in path.parts)
    print(
        f"from pip install to the first still: {done - start:.0f} s, of which "
        f"{installed - start:.0f} s install and {done - installed:.0f} s render {pictures}"
    )


def main() -> None:
    """All of it."""
    wheel = built()
    checked(wheel)
    with tempfile.TemporaryDirectory() as folder:
        tried(wheel, Path(folder))


if __name__ == "__main__":
    main()
