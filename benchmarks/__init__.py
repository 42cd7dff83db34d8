"""Benchmarks: what no picture of a study shows, in a checkout: ``python -m benchmarks.NAME``.

`rays`, `kernels`, `memory` and `startup` measure what a renderer costs, for every variant of a
STUDY (as for ``mitsuba-restir evaluate``, or a file beside this one), `previews` what steering adds
to the frames of stills. `digests` tells whether a change of the code changed a frame, `moving` how
true frames of a scene that moves are, `viewer` how fast pictures follow the mouse.
"""

import mitsuba_restir  # noqa: F401  (makes an LLVM findable before Mitsuba looks for one)
