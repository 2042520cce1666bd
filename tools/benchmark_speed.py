# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How fast the odometry is, and what its time depends on, as Markdown tables and a plot.

    python tools/benchmark_speed.py --out speed [--data DATA]

- `ruledgraph smooth` on a rendered recording of 12 s at 640x480 and 90 Hz, and with --data on 30 s
  of EuRoC MH_01_easy: wall time with start of the program, reading, decoding and writing, and the
  peak of its memory;
- how long after a frame its live pose is there, between states and at states;
- the same recording by the paper's solver, which is one of its baselines;
- processor time at half the frame rate, and of both recordings with at most 5 to 60 lines.

Each figure is the least of so many runs as --repeat says: other work on the machine only adds.
How time and memory grow over an hour is a matter for tools/soak.py.
"""

import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from datetime import date
from functools import partial
from itertools import count
from operator import itemgetter
from pathlib import Path
from typing import TypeAlias, TypeVar

import click
import numpy as np

from benchmark_accuracy import REAL_SLICE, real_recording
from ruledgraph.baselines.paper import PaperOdometry
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import Config, EdgesConfig
from ruledgraph.core.measurements import Frame, Measurement
from ruledgraph.core.versions import machine_text, version_text
from ruledgraph.odometry import Odometry
from ruledgraph.recording import open_recording
from ruledgraph.simulation import simulate
from ruledgraph.simulation.write import write_simulation

SCENE, MOTION = "noncoplanar_cluttered", "free"
SECONDS = 12.0
MAX_LINES = (5, 10, 20, 30, 60)

T = TypeVar("T")


def least(run: Callable[[], T], repeat: int, key: Callable[[T], float]) -> T:
    """The run whose key is the least."""
    return min((run() for _ in range(repeat)), key=key)


def smooth(recording: Path, calibration: Path) -> tuple[float, float]:
    """Wall time (s) and peak memory (MB) of the command line."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "ruledgraph", "smooth", str(recording.resolve())]
        command += ["--calibration", str(calibration.resolve()), "--output", "results"]
        started = time.perf_counter()
        nowhere = subprocess.DEVNULL
        # From elsewhere: a source tree in the working folder would be imported, without its kernel.
        process = subprocess.Popen(  # noqa: S603 - ours
            command, stderr=nowhere, stdout=nowhere, cwd=folder
        )
        peak = 0.0
        while process.poll() is None:
            peak = max(peak, peak_memory(process.pid))
            time.sleep(0.02)
        if process.returncode:
            raise click.ClickException(f"failed: {' '.join(command)}")
        return time.perf_counter() - started, peak


def peak_memory(pid: int) -> float:
    """Of a process so far, MB; what `getrusage` says of a child begins with its parent's."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024.0
    return 0.0  # it has just ended


def latencies(
    measurements: Sequence[Measurement], calibration: Calibration
) -> tuple[list[float], list[float]]:
    """Seconds that frames between states and at states took, once the odometry has started."""
    odometry = Odometry(calibration)
    between: list[float] = []
    at_states: list[float] = []
    for measurement in measurements:
        started = time.perf_counter()
        odometry.add(measurement)
        elapsed = time.perf_counter() - started
        for estimate in odometry.take_live():
            (at_states if estimate.at_state else between).append(elapsed)
    return between, at_states


def processor_time(
    measurements: Sequence[Measurement], make: Callable[[], Odometry | PaperOdometry]
) -> tuple[float, float]:
    """Seconds of all threads, and graph lines in view on average."""
    odometry = make()
    lines: list[int] = []
    started = time.process_time()
    for measurement in measurements:
        odometry.add(measurement)
        lines += [estimate.lines for estimate in odometry.take_live()]
    odometry.finish()
    return time.process_time() - started, float(np.mean(lines or [0]))


def with_most_lines(most: int) -> Config:
    """The default settings but for the number of lines that are followed."""
    return Config(edges=EdgesConfig(max_lines=most))


Row: TypeAlias = tuple[int, float, float]
"""Most lines, lines in view on average, processor time of a second, s."""


def by_lines(
    measurements: Sequence[Measurement], calibration: Calibration, repeat: int
) -> list[Row]:
    """The cost with at most so many lines; none of where no estimate begins."""
    stamps = [frame.stamp for frame in measurements if isinstance(frame, Frame)]
    seconds = 1e-9 * (stamps[-1] - stamps[0])
    rows = []
    for most in MAX_LINES:
        make = partial(Odometry, calibration, with_most_lines(most))
        spent, lines = least(partial(processor_time, measurements, make), repeat, itemgetter(0))
        if lines > 0.0:
            rows.append((most, lines, spent / seconds))
    return rows


def draw(rows: Mapping[str, Sequence[Row]], path: Path) -> None:
    """Processor time over the number of lines."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    for name, of_recording in rows.items():
        _, lines, costs = zip(*of_recording, strict=True)
        axes.plot(lines, costs, "o-", label=name)
        for row in of_recording:
            axes.annotate(str(row[0]), row[1:], (6, -10), textcoords="offset points")
    axes.set(title="with at most so many lines")
    axes.set(xlabel="graph lines in view", ylabel="processor time per second of recording")
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)


@click.command(help=__doc__)
@click.option("--out", type=click.Path(path_type=Path), required=True, help="For the plot.")
@click.option("--data", type=click.Path(exists=True, file_okay=False), help="Recorded data.")
@click.option("--repeat", default=3, show_default=True, help="Runs of each figure.")
@click.option("--seconds", default=SECONDS, show_default=True, help="Of the simulations.")
def main(out: Path, data: str | None, repeat: int, seconds: float) -> None:
    """Command line."""
    # One after the other, and not by workers: their threads would count as processor time.
    out.mkdir(parents=True)
    click.echo(f"{version_text()}\n{machine_text()}, {platform.machine()}, {date.today()}\n")
    with tempfile.TemporaryDirectory() as folder:
        simulation = simulate(SCENE, MOTION, duration=seconds)
        files = write_simulation(simulation, Path(folder) / "simulated.bag", "rosbag1")
        recordings = {f"simulated, {seconds:g} s": (files.recording, files.calibration)}
        if data is not None:
            bag = Path(data) / f"{REAL_SLICE}.bag"
            recordings["MH_01, 30 s"] = bag, bag.with_suffix(".calib.yaml")
        measurements = list(open_recording(files.recording).stream())
        click.echo("| recording | wall time, s | memory, MB |\n|---|---:|---:|")
        for name, paths in recordings.items():
            wall, memory = least(partial(smooth, *paths), repeat, itemgetter(0))
            click.echo(f"| {name} | {wall:.1f} | {memory:.0f} |")

    calibration = simulation.calibration
    between, at_states = least(
        partial(latencies, measurements, calibration), repeat, lambda found: sum(found[0])
    )
    click.echo("\n| latency, ms | median | p99 | largest |\n|---|---:|---:|---:|")
    for name, found in (("between states", between), ("at states", at_states)):
        figures = 1e3 * np.quantile(found, [0.5, 0.99, 1.0])
        click.echo(f"| {name} | " + " | ".join(f"{figure:.1f}" for figure in figures) + " |")

    def cost(part: Sequence[Measurement], make: Callable[[], Odometry | PaperOdometry]) -> float:
        return least(partial(processor_time, part, make), repeat, itemgetter(0))[0]

    frames = sum(isinstance(measurement, Frame) for measurement in measurements)
    ours = cost(measurements, partial(Odometry, calibration))
    paper = cost(measurements, partial(PaperOdometry, calibration))
    frame_number = count()
    half = [m for m in measurements if not isinstance(m, Frame) or next(frame_number) % 2 == 0]
    halved = cost(half, partial(Odometry, calibration))
    click.echo("\n| processor time | a frame, ms | a second, s |\n|---|---:|---:|")
    for name, seconds_spent, number in (
        ("factor graph", ours, frames),
        ("at half the frame rate", halved, frames / 2),
        ("the paper's solver", paper, frames),
    ):
        row = f"{1e3 * seconds_spent / number:.2f} | {seconds_spent / seconds:.2f}"
        click.echo(f"| {name} | {row} |")
    click.echo(
        f"\nthe paper's solver takes {paper / ours:.1f} times as long; "
        f"twice the frame rate costs {ours / halved:.2f} times as much\n"
    )

    rows = {"simulated": by_lines(measurements, simulation.calibration, repeat)}
    if data is not None:  # a real room has more lines
        stream, calibration, _ = real_recording(str(Path(data) / REAL_SLICE), seconds)
        rows["MH_01"] = by_lines(list(stream), calibration, repeat)
    click.echo("| recording | lines at most | in view | processor time of a second, s |")
    click.echo("|---|---:|---:|---:|")
    for name, of_recording in rows.items():
        for most, lines, cost_of_second in of_recording:
            click.echo(f"| {name} | {most} | {lines:.1f} | {cost_of_second:.2f} |")
    draw(rows, out / "lines.png")


if __name__ == "__main__":
    main()
