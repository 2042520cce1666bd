# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A run, step by step, for those who observe it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from ruledgraph.app.solvers import AnyOdometry
from ruledgraph.core.estimates import Estimate, LineEstimate
from ruledgraph.core.measurements import Frame


@dataclass(frozen=True)
class Step:
    """What came of a frame, or of the end of a run."""

    odometry: AnyOdometry
    """What it has processed may be the frame before, see `FrameQueue`."""
    frame: Frame | None
    """That was added; None at the end."""
    live: Sequence[Estimate]
    smoothed: Sequence[Estimate]
    lines: Sequence[LineEstimate]


Observer: TypeAlias = Callable[[Step], None]
"""Sees each step of a run when it is done."""


def take_step(odometry: AnyOdometry, frame: Frame | None) -> Step:
    """Take from the odometry what has come since the step before."""
    live, smoothed, lines = odometry.take_live(), odometry.take_smoothed(), odometry.take_lines()
    return Step(odometry, frame, live, smoothed, lines)
