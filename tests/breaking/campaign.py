"""Runs the seeds of a campaign, each in a process of its own, and keeps what became of them."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.progress import track

ROOT = Path(__file__).resolve().parents[2]
LAST_WORDS = 2000
"""Characters of a child's standard error that are kept where it ended without a result."""

Record = dict[str, Any]


@dataclass(frozen=True)
class Campaign:
    """Which seeds are run, and how.

    Fields: ``seeds`` (how many), ``first`` (of them), ``jobs`` (at a time), ``timeout`` (of one
    [s]), ``out`` (the folder of ``results.jsonl``).
    """

    seeds: int
    first: int
    jobs: int
    timeout: float
    out: Path

    @property
    def results(self) -> Path:
        return self.out / "results.jsonl"

    def command(self, seed: int) -> list[str]:
        """What runs and checks one seed, at the level of this campaign."""
        return ["-m", "tests.breaking", "--seed", str(seed), "--seeds", str(self.seeds)]


def known(campaign: Campaign) -> dict[int, Record]:
    """Records of the seeds that are done, at the level of this campaign; torn lines are none."""
    records = {}
    if campaign.results.exists():
        for line in campaign.results.read_text().splitlines():
            try:
                record = json.loads(line)
            except json.JSONDecodeError:
                continue
            if record["seeds"] == campaign.seeds:
                records[record["seed"]] = record
    wanted = range(campaign.first, campaign.first + campaign.seeds)
    return {seed: record for seed, record in records.items() if seed in wanted}


def run(campaign: Campaign, report: Callable[[Record], None]) -> dict[int, Record]:
    """Run the seeds that are not done; each is kept and reported as it comes.

    Returns
    -------
    dict
        The records of all seeds.
    """
    records = known(campaign)
    todo = [
        seed
        for seed in range(campaign.first, campaign.first + campaign.seeds)
        if seed not in records
    ]
    campaign.out.mkdir(parents=True, exist_ok=True)
    with _appended(campaign.results) as write, _children(campaign) as child:
        pool = ThreadPoolExecutor(campaign.jobs)
        try:
            futures = [pool.submit(child, seed) for seed in todo]
            done = as_completed(futures)
            for future in track(done, "seeds", total=len(todo), transient=True):
                record = future.result()
                write(record)
                records[record["seed"]] = record
                report(record)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
    return records


@contextmanager
def _appended(path: Path) -> Iterator[Callable[[Record], None]]:
    """A function that appends a line; a line that a kill has torn is closed first."""
    torn = path.exists() and not path.read_bytes().endswith(b"\n") and path.stat().st_size > 0
    with path.open("a") as file:
        if torn:
            file.write("\n")

        def write(record: Record) -> None:
            file.write(json.dumps(record) + "\n")
            file.flush()

        yield write


@contextmanager
def _children(campaign: Campaign) -> Iterator[Callable[[int], Record]]:
    """A function that runs a seed; what still runs at the end of the context is killed."""
    alive: set[subprocess.Popen[bytes]] = set()

    def child(seed: int) -> Record:
        start = time.monotonic()
        with tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as errors:
            command = [sys.executable, *campaign.command(seed), "--json"]
            process = subprocess.Popen(command, cwd=ROOT, stdout=said, stderr=errors)
            alive.add(process)
            try:
                process.wait(campaign.timeout)
                failure = f"crash: exit code {process.returncode}"
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                failure = f"hang: killed after {campaign.timeout:g} s"
            finally:
                alive.discard(process)
            said.seek(0)
            errors.seek(0)
            record = _last_record(said.read().decode(errors="replace"))
            if record is None:
                kind, _, seen = failure.partition(": ")
                words = errors.read().decode(errors="replace")[-LAST_WORDS:]
                record = {"seed": seed, "failures": {kind: f"{seen}\n{words}"}}
        seconds = round(time.monotonic() - start, 1)
        return {**record, "seeds": campaign.seeds, "seconds": seconds}

    try:
        yield child
    finally:
        for process in list(alive):
            process.kill()


def _last_record(said: str) -> Record | None:
    """The record in the last line of a child's standard output."""
    try:
        record = json.loads(said.splitlines()[-1])
    except (IndexError, json.JSONDecodeError):
        return None
    return record if isinstance(record, dict) else None
