"""A tiny render in a process of its own, because an unsuitable LLVM aborts the process.

``python -m mitsuba_restir.cli.probe VARIANT`` prints one JSON object per finished step, so that
whoever started it knows how far it came.
"""

from __future__ import annotations

import json
import math
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Any

RENDERED = ("path", "restir_pt")
"""Integrators that render 16x16 pixels."""

STEPS = ("variant", *RENDERED, "frame")
FRAME = (320, 180)
"""Pixels of the frame that is timed."""

_SIZE = 16
_WARM_UP, _FRAMES = 3, 7


@dataclass(frozen=True)
class Probe:
    """
    Outcome of a probe.

    Fields
    ------
    variant : str
    seconds : dict of str to float
        Time of each finished step, those of `STEPS` in order; ``frame`` is that of one frame of
        `FRAME` pixels of the embedded room, once all is compiled.
    llvm_version : str or None
        Version that Dr.Jit loaded, None where it loaded none.
    error : str or None
        Why the next step failed; None where all went well.
    """

    variant: str
    seconds: dict[str, float]
    llvm_version: str | None
    error: str | None


def probe(variant: str, timeout: float = 300.0) -> Probe:
    """Render 16x16 pixels with `path` and `restir_pt`, and time a frame, in a subprocess."""
    command = [sys.executable, "-m", "mitsuba_restir.cli.probe", variant]
    try:
        process = subprocess.run(
            command, capture_output=True, text=True, timeout=timeout, errors="replace", check=False
        )
    except subprocess.TimeoutExpired:
        return Probe(variant, {}, None, f"not finished after {timeout:.0f} s")
    steps = [json.loads(line) for line in process.stdout.splitlines() if line.startswith("{")]
    seconds = {step["step"]: step["seconds"] for step in steps}
    llvm_version = next((step["llvm"] for step in steps if step.get("llvm")), None)
    error = None if process.returncode == 0 else _reason(process.returncode, process.stderr)
    return Probe(variant, seconds, llvm_version, error)


def _reason(code: int, stderr: str) -> str:
    lines = [line.strip() for line in stderr.splitlines() if line.strip()]
    if code < 0:
        fatal = next((line for line in lines if "ERROR" in line), lines[0] if lines else "")
        return f"the process was aborted by signal {-code}: {fatal[:160]}"
    return lines[-1][:300] if lines else f"the process ended with code {code}"


def _render(integrator: str) -> None:
    import mitsuba as mi
    import numpy as np

    description = mi.cornell_box()
    description["sensor"]["film"].update(
        width=_SIZE, height=_SIZE, rfilter={"type": "box"}, pixel_format="rgb"
    )
    scene = mi.load_dict(description)
    image = mi.render(scene, integrator=mi.load_dict({"type": integrator}), spp=1)
    mean = float(np.asarray(image).mean())
    if not (math.isfinite(mean) and mean > 0.0):
        raise ValueError(f"{integrator} rendered an image whose mean is {mean}")


def _frame_time() -> float:
    """Median time of a frame with history [s]."""
    import drjit as dr
    import mitsuba as mi

    from .. import scenes

    scene = scenes.load("ajar", *FRAME)
    integrator = mi.load_dict({"type": "restir_pt", "max_depth": 10})
    times = []
    for seed in range(_WARM_UP + _FRAMES):
        start = time.perf_counter()
        dr.eval(mi.render(scene, integrator=integrator, spp=1, seed=seed))
        dr.sync_thread()
        times.append(time.perf_counter() - start)
    return statistics.median(times[_WARM_UP:])


def _main(variant: str) -> None:
    import drjit as dr
    import mitsuba as mi

    def report(step: str, start: float, **more: Any) -> None:
        entry = {"step": step, "seconds": time.perf_counter() - start, **more}
        print(json.dumps(entry), flush=True)

    start = time.perf_counter()
    mi.set_variant(variant)
    version = dr.detail.llvm_version()
    loaded = ".".join(map(str, version)) if version[0] >= 0 else None
    report("variant", start, llvm=loaded)
    for step in RENDERED:
        start = time.perf_counter()
        _render(step)
        report(step, start)
    print(json.dumps({"step": "frame", "seconds": _frame_time()}), flush=True)


if __name__ == "__main__":
    _main(sys.argv[1])
