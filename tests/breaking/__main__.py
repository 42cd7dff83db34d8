"""The command line of the campaign: ``python -m tests.breaking``."""

from __future__ import annotations

import argparse
import json
import sys
import traceback
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from . import campaign as campaigns
from . import pixels, trial
from .generator import combination


def main() -> int:
    """Do what is asked for; 1 where something failed."""
    options = _parser().parse_args()
    if options.pixels:
        return _pixels(int(options.pixels), options.first)
    if options.seed is not None:
        return _seed(options.seed, options.seeds, options.json)
    return _campaign(
        campaigns.Campaign(options.seeds, options.first, options.jobs, options.timeout, options.out)
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.breaking", description=__doc__)
    parser.add_argument("--seeds", type=int, default=200, help="how many seeds a campaign has")
    parser.add_argument("--first", type=int, default=0, help="the first of them")
    parser.add_argument("--jobs", type=int, default=1, help="seeds that are run at a time")
    parser.add_argument("--timeout", type=float, default=300.0, help="of one seed, in seconds")
    parser.add_argument(
        "-o", "--out", type=Path, default=Path("out/breaking"), help="folder of the results"
    )
    parser.add_argument("--seed", type=int, help="only this seed, in this process")
    parser.add_argument("--json", action="store_true", help="print the record of --seed")
    parser.add_argument(
        "--pixels", type=float, help="instead, count what is not finite in so many pixels"
    )
    return parser


def _seed(seed: int, seeds: int, as_json: bool) -> int:
    try:
        result = trial.run(seed, seeds)
    except Exception:
        result = trial.Result({"error": traceback.format_exc()})
    chosen = combination(seed)
    record = {
        "seed": seed,
        **asdict(result),
        "variant": chosen.variant,
        "made_of": chosen.names,
        "parameters": chosen.parameters,
        "spp": chosen.spp,
        "frames": chosen.frames,
        "moving": chosen.moving,
    }
    # Mitsuba's warnings are on standard output as well, and leave their last line open.
    print("\n" + json.dumps(record) if as_json else _page(record))
    return 1 if result.failures else 0


def _page(record: dict[str, Any]) -> str:
    lines = [f"{key}: {value}" for key, value in record.items() if key != "failures"]
    failed = [f"FAILED, {kind}: {seen}" for kind, seen in record["failures"].items()]
    return "\n".join([*lines, *failed])


def _campaign(campaign: campaigns.Campaign) -> int:
    def report(record: dict[str, Any]) -> None:
        if record["failures"]:
            kinds = ", ".join(record["failures"])
            print(f"{kinds}: python {' '.join(campaign.command(record['seed']))}", flush=True)

    for record in campaigns.known(campaign).values():
        report(record)
    try:
        campaigns.run(campaign, report)
    except KeyboardInterrupt:
        print(f"interrupted; what is done is kept in {campaign.results}", file=sys.stderr)
        return 130
    finally:
        _summary(campaign)
    return 1 if any(r["failures"] for r in campaigns.known(campaign).values()) else 0


def _summary(campaign: campaigns.Campaign) -> None:
    records = list(campaigns.known(campaign).values())
    if not records:
        return
    failed = Counter(kind for record in records for kind in record["failures"])
    against = Counter(str(record.get("yardstick")).split(":")[0] for record in records)
    suspects = sum(len(record.get("p_values", [])) > 1 for record in records)
    print(
        f"{len(records)} of {campaign.seeds} seeds: {sum(bool(r['failures']) for r in records)} "
        f"failed {dict(failed)}; {against['path']} compared with path at a false-alarm rate of "
        f"{trial.ALPHA:g} for the campaign, {suspects} of them twice; "
        f"{sum(r.get('refused', 0) for r in records)} values refused as not finite; "
        f"{sum(r['seconds'] for r in records):.0f} s"
    )


def _pixels(wanted: int, first: int) -> int:
    done, bad = 0, 0
    for count in pixels.counts(wanted, first):
        done += count.pixels
        wrong = count.bad + count.history + count.refused
        bad += wrong
        print(
            f"seed {count.seed}: {done:.4g} pixels; not finite: {count.bad} pixels, "
            f"{count.history} values of the history, {count.refused} values refused",
            flush=True,
        )
        if wrong:
            size = pixels.SIDE**2 * pixels.FRAMES
            print(f"python -m tests.breaking --pixels {size} --first {count.seed}", flush=True)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
