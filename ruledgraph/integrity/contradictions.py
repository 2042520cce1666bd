# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether images and IMU contradict each other, and whether lines fit their points."""

from collections.abc import Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.states import Interval
from ruledgraph.core.config import IntegrityConfig
from ruledgraph.core.timing import Messages


class ImuCheck:
    """Compares the estimate with the IMU."""

    def __init__(self, warnings: Messages, config: IntegrityConfig) -> None:
        self._warnings = warnings
        self._config = config
        self.contradicts = False
        """Whether images and IMU do."""

    def update(self, window: Window) -> None:
        """Take in the window's newest state."""
        error, limits, time = imu_error(window, self._config), self._config, window.newest.time
        if error is None:
            return
        if error > limits.max_error and not self.contradicts:
            self._warnings.append(
                f"images and IMU disagree since {time:.2f} s: check time offset, extrinsics "
                "and the IMU's range"
            )
        self.contradicts = error > (limits.agreed_error if self.contradicts else limits.max_error)


class LineCheck:
    """Compares lines with their points."""

    def __init__(self, warnings: Messages, config: IntegrityConfig) -> None:
        self._warnings = warnings
        self._config = config
        self._misfit = 0.0
        self._misfit_since: float | None = None
        self.lost = False
        """Whether most lines do not fit the estimate."""

    @property
    def misfits(self) -> bool:
        """Whether too many lines do not fit the estimate."""
        return self._misfit_since is not None

    def excess(self, window: Window, still: bool) -> float:
        """By how much the share of lines that do not fit says that covariances are too small; when
        most do not, the estimate is lost.
        """
        limits, time = self._config, window.newest.time
        misfit = misfit_share(window, limits)
        if misfit is not None:
            self._misfit = misfit
            if misfit > limits.max_misfit and self._misfit_since is None:
                self._misfit_since = time
                self._warnings.append(
                    f"{misfit:.0%} of the lines do not fit the estimate at {time:.2f} s: it "
                    "may be lost, time offset or extrinsics may be wrong, or much of the image "
                    "moves"
                )
            elif misfit < limits.agreed_misfit:
                self._misfit_since = None
        since = self._misfit_since
        is_long = since is not None and time - since >= limits.lost_time
        # Without enough lines: in motion the others were lost, at rest none are compared.
        compared = misfit is not None or not still
        self.lost = compared and self._misfit > (
            limits.max_misfit if is_long else limits.lost_misfit
        )
        return 1.0 if misfit is None else (misfit / limits.usual_misfit) ** 2


def imu_error(window: Window, config: IntegrityConfig) -> float | None:
    """Twice the error of the last IMU factors, on average, without the newest one, which little
    contradicts yet; None if there are too few.
    """
    intervals = _last(list(window.intervals), window, config)
    if len(intervals) < config.min_intervals:
        return None
    values = gtsam.Values()
    for interval in intervals:
        node = interval.node
        values.insert(X(node.index), node.state.pose())
        values.insert(V(node.index), node.state.velocity())
        values.insert(B(node.index), node.bias)
    errors = [interval.imu_factors[0].error(values) for interval in intervals[:-1]]
    return 2.0 * float(np.mean(errors))


def misfit_share(window: Window, config: IntegrityConfig) -> float | None:
    """Share of the last intervals' lines that did not fit; None if there are too few."""
    # At rest most intervals have none.
    observed = [i for i in window.intervals if i.compared or not i.still]
    intervals = _last(observed, window, config)
    compared = sum(interval.compared for interval in intervals)
    misfits = sum(interval.misfits for interval in intervals)
    return misfits / compared if compared >= config.min_observations else None


def _last(
    intervals: Sequence[Interval], window: Window, config: IntegrityConfig
) -> Sequence[Interval]:
    recent = sum(i.node.time >= window.newest.time - config.span for i in intervals)
    return intervals[-max(recent, config.min_intervals) :]
