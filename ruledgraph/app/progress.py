# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How far a run is, on standard error."""

import sys
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeAlias

import click
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from ruledgraph.app.steps import Observer, Step

# Between lines of progress where there is no terminal, s.
_INTERVAL = 5.0


@dataclass(frozen=True)
class _State:
    frames: int
    seconds: float
    """Of the recording."""
    lines: int
    status: str


_Show: TypeAlias = Callable[[_State], None]


@contextmanager
def progress_bar(total: int | None) -> Iterator[Observer]:
    """A bar on a terminal, elsewhere a line every few seconds.

    Args:
        total: how many frames there are, if that is known.
    """
    if not sys.stderr.isatty():
        yield _counting(_lines(total))
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TaskProgressColumn(show_speed=True),
        TimeRemainingColumn(),
        TextColumn("{task.fields[lines]} lines"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("smoothing", total=total, lines=0)

        def show(state: _State) -> None:
            bar.update(task, completed=state.frames, lines=state.lines, description=state.status)

        yield _counting(show)


def _counting(show: _Show) -> Observer:
    """Counts the frames, and shows how far they are."""
    frames, first = 0, None

    def observe(step: Step) -> None:
        nonlocal frames, first
        if step.frame is None:
            return
        frames += 1
        first = step.frame.stamp if first is None else first
        window = step.odometry.window
        lines = 0 if window is None else len(window.lines)
        status, _, _ = step.odometry.status.partition(":")  # without the reason, which is long
        show(_State(frames, (step.frame.stamp - first) * 1e-9, lines, status))

    return observe


def _lines(total: int | None) -> _Show:
    said = clock.monotonic()

    def show(state: _State) -> None:
        nonlocal said
        if clock.monotonic() - said >= _INTERVAL:
            said = clock.monotonic()
            frames = (
                f"{state.frames} frames" if total is None else f"{state.frames} of {total} frames"
            )
            text = f"{frames}, {state.seconds:.1f} s, {state.status}, {state.lines} lines"
            click.echo(text, err=True)

    return show
