# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A whole recording through the odometry, with everything written down."""

import time as clock
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

from ruledgraph.app.found_calibration import write_found_calibration
from ruledgraph.app.interrupts import CaughtSignals
from ruledgraph.app.results import Results
from ruledgraph.app.run_input import RunInput
from ruledgraph.app.solvers import AnyOdometry, Solver, odometry_for
from ruledgraph.app.steps import Observer, take_step
from ruledgraph.app.summary import Tally, about, accuracies, figures, write_ground_truth
from ruledgraph.app.trajectory_files import TrajectoryFormat
from ruledgraph.core.config import Config
from ruledgraph.core.errors import RuledgraphError, machine_error
from ruledgraph.core.measurements import Frame, Measurement
from ruledgraph.odometry import Odometry
from ruledgraph.recording.read_ahead import read_ahead

# With reliable estimates of fewer frames than this share, the likely causes are looked for.
_FEW = 0.5
# Measurements read ahead, a few frames' worth.
_READ_AHEAD = 64


def run(
    given: RunInput,
    config: Config,
    output: Path,
    *,
    solver: Solver = "graph",
    formats: Sequence[TrajectoryFormat] = (),
    observers: Sequence[Observer] = (),
) -> dict[str, Any]:
    """Smooth a recording and write its results; what was computed stays, however it ends.

    Args:
        given: what it reads.
        config: all settings.
        output: folder for the results, see `Results`.
        solver: the paper's has no use for `config`, and no covariances.
        formats: of trajectories, beside TUM's.
        observers: see each step when its results are written.

    Returns:
        What `summary.json` holds.

    Raises:
        RuledgraphError: for a recording that holds nothing to work on; `MachineError` without
            disk space, memory or threads. Results are in `output`.
    """
    odometry = odometry_for(solver, given.calibration, config)
    tally = Tally()
    started = clock.perf_counter()
    results = Results(output, config, formats)

    def hand_over(frame: Frame | None) -> None:
        step = take_step(odometry, frame)
        results.write(step.live, step.smoothed, step.lines)
        tally.add(step)
        for observe in observers:
            observe(step)

    first = _FirstError()
    with CaughtSignals() as caught:
        with first.kept(), _reading(given.measurements, odometry) as taken:
            for measurement in taken:
                if caught.number:
                    break
                odometry.add(measurement)
                if isinstance(measurement, Frame):
                    hand_over(measurement)
        results.use_reserve()
        for last in (odometry.finish, partial(hand_over, None), results.close):
            with first.kept():
                last()
        wall_s = clock.perf_counter() - started
        tally.map_lines = len(results.lines)
        ended = "interrupted" if caught.number or first.is_interrupt else first.text or "complete"
        warnings = [*given.warnings(), *odometry.warnings]
        summary = about(solver, given.names) | figures(
            odometry, tally, ended=ended, wall_s=wall_s, warnings=warnings
        )
        if caught.number:
            summary["signal"] = caught.number
        with first.kept():
            if ended == "complete" and tally.reliable < _FEW * max(tally.frames, 1):
                summary["likely_causes"] = given.likely_causes()
            if given.ground_truth is not None and tally.estimates:
                summary["accuracy"] = accuracies(output, given.ground_truth)
                write_ground_truth(output, given.ground_truth)
        with first.kept():
            results.summarize(summary)
            if isinstance(odometry, Odometry) and tally.estimates:
                write_found_calibration(odometry, output / "calibration.yaml")
    if first.error is not None and not first.is_interrupt:
        raise first.error
    return summary


class _FirstError:
    """What went wrong first: everything else is tried all the same."""

    def __init__(self) -> None:
        self.error: BaseException | None = None

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Keep what is raised inside, unless there was an error before."""
        try:
            yield
        except BaseException as error:  # noqa: BLE001 - raised at the end
            if self.error is None:
                self.error = machine_error(error) or error

    @property
    def is_interrupt(self) -> bool:
        """Whether it is a Ctrl-C outside the time in which signals are noted."""
        return isinstance(self.error, KeyboardInterrupt)

    @property
    def text(self) -> str:
        """In a line, empty without one."""
        if self.error is None or isinstance(self.error, RuledgraphError):
            return "" if self.error is None else str(self.error)
        return f"{type(self.error).__name__}: {self.error}"


def _reading(
    measurements: Iterable[Measurement], odometry: AnyOdometry
) -> AbstractContextManager[Iterable[Measurement]]:
    """The measurements, for the factor graph read and prepared ahead."""
    if isinstance(odometry, Odometry):
        return closing(read_ahead(measurements, partial(_prepare, odometry), _READ_AHEAD))
    return nullcontext(measurements)


def _prepare(odometry: Odometry, measurement: Measurement) -> None:
    if isinstance(measurement, Frame):
        odometry.prefetch(measurement)
