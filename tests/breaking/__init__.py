"""A campaign that tries to break ``restir_pt``: random scenes, edits and parameters, one a seed.

    python -m tests.breaking -o out/breaking          # 200 seeds; goes on where it was ended
    python -m tests.breaking --seed 17                # one of them, and why it failed
    python -m tests.breaking --pixels 1e8             # large frames: is a pixel not finite?

``generator`` makes what a seed stands for, ``trial`` renders and checks it, ``campaign`` runs every
seed in a process of its own, so that a crash or a hang is a finding and not the end.
"""

import sys
from pathlib import Path

# Scenes and statistics are those of the tests, which pytest imports from their folder.
if (_TESTS := str(Path(__file__).resolve().parents[1])) not in sys.path:
    sys.path.insert(0, _TESTS)

import mitsuba_restir  # noqa: F401  (before Mitsuba: it finds the LLVM)
