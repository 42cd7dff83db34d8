"""Which LLVM is chosen, and what `doctor` says when it does not work."""

import ctypes.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from mitsuba_restir import llvm
from mitsuba_restir.cli import machine
from mitsuba_restir.cli.doctor import diagnose, install_llvm_command
from mitsuba_restir.cli.probe import Probe


@pytest.mark.parametrize(
    ("path", "version"),
    [
        ("/usr/lib/x86_64-linux-gnu/libLLVM-15.so.1", 15),
        ("/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1", 19),
        ("/usr/lib/llvm-20/lib/libLLVM.so", 20),
        ("/opt/homebrew/opt/llvm@21/lib/libLLVM.dylib", 21),
        ("/opt/homebrew/Cellar/llvm/22.1.0/lib/libLLVM.dylib", 22),
        ("/usr/lib/libLLVM.so", None),
    ],
)
def test_version_is_read_from_the_name(path, version):
    assert llvm.version_in(Path(path)) == version


def test_version_is_read_from_what_a_link_points_to(tmp_path):
    (tmp_path / "libLLVM.so.19.1").touch()
    (tmp_path / "libLLVM.so").symlink_to("libLLVM.so.19.1")
    assert llvm.version_in(tmp_path / "libLLVM.so") == 19


def test_newest_usable_system_library_wins():
    names = ("libLLVM-16.so.1", "libLLVM.so.19.1", "libLLVM.so.20.1", "libLLVM.so")
    assert llvm.newest(Path("/usr/lib") / name for name in names) == Path(
        "/usr/lib/libLLVM.so.20.1"
    )
    assert llvm.newest([Path("/usr/lib/libLLVM-16.so.1")]) is None


def test_order_is_user_then_wheel_then_system(monkeypatch):
    monkeypatch.setattr(llvm, "wheel_library", lambda: Path("/wheel"))
    monkeypatch.setattr(llvm, "system_library", lambda: Path("/system"))
    assert llvm.find({llvm.ENVIRONMENT_VARIABLE: "/user"}).path == Path("/user")
    assert llvm.find({llvm.ENVIRONMENT_VARIABLE: ""}).path == Path("/wheel")
    monkeypatch.setattr(llvm, "wheel_library", lambda: None)
    assert llvm.find({}).path == Path("/system")
    monkeypatch.setattr(llvm, "system_library", lambda: None)
    assert llvm.find({}).path is None


@pytest.mark.skipif(sys.platform != "linux", reason="the wheel is for Linux")
def test_library_of_the_wheel_is_found():
    pytest.importorskip("mitsuba_restir")
    path = llvm.wheel_library()
    if path is None:
        pytest.skip("karellen-llvm-core is not installed")
    assert path.is_file()
    assert (llvm.version_in(path) or 0) >= llvm.OLDEST_USABLE


def test_importing_too_late_is_explained():
    good = llvm.Llvm(Path("/good"), "")
    assert llvm.too_late_message((19, 1, 7), good) is None
    assert llvm.too_late_message((15, 0, 6), llvm.Llvm(None, "")) is None
    assert "LLVM 15.0.6" in (llvm.too_late_message((15, 0, 6), good) or "")
    assert "no LLVM" in (llvm.too_late_message((-1, -1, -1), good) or "")


def test_every_failure_has_one_command_that_mends_it(tmp_path):
    ours = llvm.Llvm(Path("/usr/lib/libLLVM.so.19.1"), "the system's")
    users = llvm.Llvm(tmp_path, f"set by {llvm.ENVIRONMENT_VARIABLE}")
    none = Probe("llvm_ad_rgb", {}, None, "no LLVM")
    aborted = Probe("llvm_ad_rgb", {"variant": 0.1}, "15.0.6", "aborted by signal 6")
    plugin = Probe("llvm_ad_rgb", {"variant": 0.1, "path": 0.1}, "19.1.7", "no plugin")
    assert diagnose(ours, Probe("llvm_ad_rgb", {}, "19.1.7", None)) is None
    for probe in (none, aborted):
        by_us, by_user = diagnose(ours, probe), diagnose(users, probe)
        assert by_us is not None
        assert by_us.command == install_llvm_command()
        assert by_user is not None
        assert by_user.command.endswith(llvm.ENVIRONMENT_VARIABLE)
    broken = diagnose(ours, plugin)
    assert broken is not None
    assert "restir_pt" in broken.reason


def test_install_command_suits_the_platform():
    assert llvm.WHEEL in install_llvm_command("linux", "x86_64")
    assert "apt" in install_llvm_command("linux", "aarch64")
    assert "brew" in install_llvm_command("darwin", "arm64")
    assert "winget" in install_llvm_command("win32", "AMD64")


def doctor(**environment):
    return subprocess.run(
        [sys.executable, "-m", "mitsuba_restir", "doctor"],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def test_doctor_finds_this_installation_ready():
    result = doctor()
    assert result.returncode == 0, result.stdout + result.stderr
    assert "Ready." in result.stdout
    assert "restir_pt" in result.stdout
    said = dict.fromkeys(line.split(maxsplit=1)[0] for line in result.stdout.splitlines())
    assert {"machine", "frame", "optional"} <= set(said)
    assert re.search(r"^machine   \d+ cores, [\d.]+ GiB of memory$", result.stdout, re.M)
    assert re.search(r"^frame     1280x720: about [\d.e+]+ s, 0\.31 GiB", result.stdout, re.M)
    for name in ("OIDN", "FLIP", "tev", "Chromium", "nicegui", "av"):
        assert re.search(rf"^optional  {name} \(.*\): (yes|no: .+)$", result.stdout, re.M)


def test_what_is_missing_comes_with_what_to_do(monkeypatch):
    monkeypatch.setattr(machine.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(machine.shutil, "which", lambda name: None)
    assert [extra.there for extra in machine.extras()] == [False] * 8
    assert all(extra.remedy for extra in machine.extras())


def test_the_time_of_a_frame_grows_as_its_pixels():
    assert machine.frame_seconds(0.1, (320, 180)) == pytest.approx(1.6)
    assert machine.memory() is None or machine.memory() > 2**28
    assert machine.cores() >= 1


@pytest.mark.parametrize("path", ["/nonsense/libLLVM.so", ctypes.util.find_library("c")])
def test_doctor_explains_a_nonsense_path(path):
    result = doctor(**{llvm.ENVIRONMENT_VARIABLE: path})
    assert result.returncode == 1
    assert f"Not ready: {llvm.ENVIRONMENT_VARIABLE}" in result.stdout
    assert result.stdout.splitlines()[-1].endswith(f"unset {llvm.ENVIRONMENT_VARIABLE}")
    assert "Traceback" not in result.stdout + result.stderr


def test_doctor_survives_an_llvm_that_aborts_the_process():
    old = list(Path("/usr/lib").glob("*/libLLVM-1[56].so*"))
    if not old:
        pytest.skip("no LLVM 15 or 16 on this machine")
    result = doctor(**{llvm.ENVIRONMENT_VARIABLE: str(old[0])})
    if result.returncode == 0:
        pytest.skip("this processor renders with an old LLVM")
    assert "FAILED at path" in result.stdout
    assert result.stdout.splitlines()[-1].endswith(f"unset {llvm.ENVIRONMENT_VARIABLE}")
