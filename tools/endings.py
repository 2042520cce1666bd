# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Runs that end before their time: is anything lost that was estimated until then?

    python tools/endings.py RECORDING --calibration FILE --signals 27 --sizes 10 --memories 10

`ruledgraph smooth` runs as often as wanted, and each run ends by SIGINT, SIGTERM or SIGHUP at a
random moment, or by a limit of the size of its files or of its memory, at random, too. A run of
which something is missing is named: a live pose that is not there smoothed, poses that the summary
does not count, no summary, a file that cannot be read, more than one line of error. The exit code
is 1 if there is one.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.trajectory import read_tum
from ruledgraph.visualization.run_tables import read_run_tables

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# The exit code without space or memory.
_MACHINE = 4
# MB. With less than so much OpenBLAS tries for minutes to get some, when it is loaded.
_MEMORY = (425.0, 455.0)
# A run that lasts longer hangs, s.
_LIMIT = 300.0


@dataclass(frozen=True)
class Ending:
    """What came of a run."""

    how: str
    code: int
    errors: str
    folder: Path

    @property
    def summary(self) -> dict[str, Any] | None:
        """What `summary.json` holds, if it is there."""
        try:
            return dict(json.loads((self.folder / "summary.json").read_text(encoding="utf-8")))
        except (OSError, ValueError):
            return None

    @property
    def kind(self) -> str:
        """When it ended: before there were results, in between, or after all."""
        if not self.folder.exists() or not any(self.folder.iterdir()):
            return "before there were results"
        return "at the end" if self.summary and self.summary["ended"] == "complete" else "midway"


def lost(ending: Ending) -> Iterator[str]:
    """What is missing of a run, a line each."""
    if ending.kind == "before there were results":
        return  # Python itself may have been interrupted while it began
    told = [line for line in ending.errors.splitlines() if line.startswith("ruledgraph: ")]
    if "Traceback" in ending.errors or len(told) > 1:
        yield f"more than one line of error, the last {ending.errors.splitlines()[-1]!r}"
    summary = ending.summary
    if summary is None:
        yield "no summary"
        return
    try:
        counts = {name: _stamps(ending.folder, name) for name in ("trajectory_live", "trajectory")}
        if counts["trajectory_live"]:
            read_run_tables(ending.folder)
    except RuledgraphError as error:
        yield str(error)
        return
    if ending.code == _MACHINE:
        return  # not all that was estimated found its place
    live, smoothed = counts.values()
    if len(live) != summary["frames_estimated"]:
        yield f"{len(live)} live poses, but {summary['frames_estimated']} frames estimated"
    if missing := len(live - smoothed):
        yield f"{missing} frames are not there smoothed"


def _stamps(folder: Path, name: str) -> set[int]:
    path = folder / f"{name}.tum"
    return set(read_tum(path).stamps.tolist()) if path.stat().st_size else set()


def run(
    arguments: list[str],
    folder: Path,
    how: str,
    *,
    number: int = 0,
    after: float = 0.0,
    limit: Callable[[], None] | None = None,
) -> Ending:
    """One run, ended by a signal after some time (s), or by a limit."""
    process = subprocess.Popen(  # noqa: S603 - this project's own command
        [sys.executable, "-m", "ruledgraph", "smooth", *arguments, "--output", str(folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=limit,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    if number:
        time.sleep(after)
        process.send_signal(number)
    try:
        _, errors = process.communicate(timeout=_LIMIT)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return Ending(how, -signal.SIGKILL, "Traceback: it hung", folder)
    return Ending(how, process.returncode, errors, folder)


def endings(
    arguments: list[str],
    folder: Path,
    signals: int,
    sizes: int,
    memories: int,
    seed: int,
) -> Iterator[Ending]:
    """Undisturbed once, for its time, sizes and memory; then as often as wanted with each."""
    started = time.monotonic()
    yield run(arguments, folder / "whole", "undisturbed")
    length = time.monotonic() - started
    largest = max(p.stat().st_size for p in (folder / "whole").iterdir())
    rng = np.random.default_rng(seed)
    for i in range(signals):
        number, after = SIGNALS[i % len(SIGNALS)], rng.uniform(0.0, 1.1 * length)
        how = f"{number.name} after {after:.2f} s of {length:.2f} s"
        yield run(arguments, folder / f"signal{i}", how, number=number, after=after)
    for i in range(sizes):
        size = int(rng.uniform(0.0, largest))
        limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (size, size))
        yield run(arguments, folder / f"size{i}", f"files of {size} bytes", limit=limit)
    for i in range(memories):
        megabytes = int(rng.uniform(*_MEMORY))
        limit = partial(resource.setrlimit, resource.RLIMIT_AS, (megabytes * 2**20,) * 2)
        yield run(arguments, folder / f"memory{i}", f"{megabytes} MB of memory", limit=limit)


@click.command(help=__doc__)
@click.argument("recording", type=click.Path(exists=True))
@click.option("--calibration", required=True, type=click.Path(exists=True))
@click.option("--signals", default=27, show_default=True)
@click.option("--sizes", default=0, show_default=True)
@click.option("--memories", default=0, show_default=True)
@click.option("--seed", default=0, show_default=True)
def main(
    recording: str, calibration: str, signals: int, sizes: int, memories: int, seed: int
) -> None:
    """Command line."""
    arguments = [recording, "--calibration", calibration]
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for ending in endings(arguments, Path(folder), signals, sizes, memories, seed):
            problems = list(lost(ending))
            counts[f"{ending.how.split()[0]}: {ending.kind}"] += 1
            counts["lost something"] += bool(problems)
            found = "; ".join(problems) or "nothing lost"
            click.echo(f"{ending.how}: exit {ending.code}, {ending.kind}: {found}", err=True)
    for name, count in sorted(counts.items()):
        click.echo(f"{name}: {count}")
    if counts["lost something"]:
        sys.exit(1)


if __name__ == "__main__":
    main()
