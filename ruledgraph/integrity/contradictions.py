# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether images and IMU contradict each other, and whether lines fit their points."""

import math
from collections.abc import Sequence

from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.states import Interval
from ruledgraph.core.config import IntegrityConfig
from ruledgraph.core.estimates import Innovation
from ruledgraph.core.messages import Messages
from ruledgraph.integrity.variance_factor import VarianceFactor


class ImuCheck:
    """Compares the innovations with each other and the noise figures; see `VarianceFactor`."""

    def __init__(self, warnings: Messages, config: IntegrityConfig) -> None:
        self._warnings = warnings
        self._confidence = config.confidence
        self.unlikely_since: float | None = None
        """Where the newest innovation is larger than noise, when its prediction began, s."""
        self.contradicts = False
        """Whether images and IMU contradict each other."""

    def update(
        self,
        innovation: Innovation | None,
        time: float,
        variance_factor: VarianceFactor,
        jumped: bool,
    ) -> None:
        """Check the innovation of the state at a time (s), before `variance_factor` takes it in.

        `jumped`: whether the contradiction was resolved as a jump of the biases.
        """
        before = self.contradicts
        if innovation is not None:
            unlikely = variance_factor.is_unlikely(innovation, time, self._confidence)
            self.unlikely_since = innovation.since if unlikely else None
        elif jumped:
            self.unlikely_since = None
        self.contradicts = jumped or self.unlikely_since is not None
        if self.contradicts and not before:
            self._warnings.append(
                f"images and IMU have disagreed since {time:.2f} s: check time offset, extrinsics, "
                "the IMU's noise figures and its range"
            )


class LineCheck:
    """Compares lines with their points."""

    def __init__(self, warnings: Messages, config: IntegrityConfig) -> None:
        self._warnings = warnings
        self._config = config
        self._misfit = 0.0
        self._misfit_since: float | None = None
        self.last_misfit_time = -math.inf
        """Time of the last state at which too many did not `fit`, s."""
        self.lost = False
        """Whether half of the lines do not fit the estimate, or too many have not for long."""

    @property
    def misfit(self) -> bool:
        """Whether too many lines do not fit the estimate."""
        return self._misfit_since is not None

    @property
    def fit(self) -> bool:
        """Whether nearly all lines fit the estimate, which ends a `misfit`."""
        return self._misfit < self._config.agreed_misfit

    def update(self, window: Window, still: bool) -> None:
        """Take in the window's newest state, and whether the body has been at rest until then."""
        limits, time = self._config, window.newest.time
        misfit = misfit_share(window, limits)
        if misfit is not None:
            self._misfit = misfit
            if not self.fit:
                self.last_misfit_time = time
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
        disagrees = is_long and self._misfit > limits.max_misfit
        self.lost = compared and (disagrees or self._misfit >= limits.lost_misfit)


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
    recent = sum(i.node.time >= window.newest.time - config.misfit_span for i in intervals)
    return intervals[-max(recent, config.min_intervals) :]
