"""Render the committed references again: ``python tests/make_references.py [NAME ...]``.

Without names, all of them: about ten minutes on two cores. Mitsuba's own ``path`` renders them,
with the depth of each case and no Russian roulette (but for unlimited depth).
"""

import sys
import time

import mitsuba_restir  # noqa: F401  isort: skip
from support.references import CASES, make, save


def main(names: list[str]) -> None:
    unknown = sorted(set(names) - set(CASES))
    if unknown:
        raise SystemExit(f"unknown: {', '.join(unknown)}; choose from {', '.join(CASES)}")
    for name in names or CASES:
        start = time.time()
        mean, variance = make(CASES[name])
        save(name, mean, variance)
        error = (variance.mean() ** 0.5) / mean.mean()
        print(f"{name}: mean {mean.mean():.4f}, error {error:.2%}, {time.time() - start:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1:])
