"""Import the package before any test imports Mitsuba: Dr.Jit loads its LLVM at import."""

import mitsuba_restir  # noqa: F401
