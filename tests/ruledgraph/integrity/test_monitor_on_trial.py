# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What the innovations of a start on trial count for."""

import gtsam
import numpy as np
import pytest
from scipy.stats import f as f_ratio

from monitored_window import monitored_window
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Innovation
from ruledgraph.core.messages import Messages
from ruledgraph.integrity.gauge import GaugeUncertainty
from ruledgraph.integrity.monitor import IntegrityMonitor


def test_what_a_start_on_trial_was_off_by_is_no_noise():
    (window, _, _), unit = monitored_window(), (np.eye(6), np.eye(3), np.eye(6))
    monitor = IntegrityMonitor(GaugeUncertainty(), Messages(), Config(), on_trial=True)

    def factor(nis: float, since: float) -> float:
        window.newest.time, window.innovation = since + 2.5, Innovation(nis, 10, since)
        monitor.update(window, False)
        return monitor.covariances(unit, gtsam.Pose3(), np.zeros(3))[1][0, 0]

    on_trial = factor(100.0, 0.0)
    monitor.confirm(1.0)
    assert factor(100.0, 0.5) == pytest.approx(on_trial)
    assert factor(10.0, 4.0) == pytest.approx(on_trial / 7.0)


def test_what_a_start_was_off_by_is_what_later_innovations_are_held_against():
    """One of 10 degrees of freedom needs a NIS of 690 to be no noise; after a small one, of 130."""
    (window, _, _), limits = monitored_window(), Config().integrity
    monitor = IntegrityMonitor(GaugeUncertainty(), Messages(), Config(), on_trial=True)
    most = 10.0 * f_ratio.ppf(limits.confidence, 10, limits.variance_prior)
    for nis, since in ((1.0, 0.0), (0.5 * most, 2.6)):
        window.newest.time, window.innovation = since + 2.5, Innovation(nis, 10, since)
        monitor.update(window, False)
        monitor.confirm(1.0)
    assert monitor.is_contradicted
