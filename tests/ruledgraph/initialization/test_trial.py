# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

from types import SimpleNamespace

import gtsam
import numpy as np

from ruledgraph.backend.start import Start
from ruledgraph.backend.states import StateNode
from ruledgraph.core.config import IntegrityConfig
from ruledgraph.initialization.trial import Trial


def start_with(lines) -> Start:
    return Start(
        stamp=0,
        time=0.0,
        state=gtsam.NavState(gtsam.Pose3(), np.zeros(3)),
        bias=gtsam.imuBias.ConstantBias(),
        pose_covariance=np.eye(6),
        velocity_sigma=1.0,
        bias_sigmas=np.ones(6),
        lines=dict.fromkeys(lines),
    )


def window_at(time: float, lines, velocity=0.0):
    state = gtsam.NavState(gtsam.Pose3(), np.array([velocity, 0.0, 0.0]))
    node = StateNode(1, time, state, gtsam.imuBias.ConstantBias(), np.eye(15))
    return SimpleNamespace(newest=node, lines=dict.fromkeys(lines))


def test_a_trial_is_passed_by_lines_that_stay():
    trial = Trial(start_with(range(6)), 1.0, IntegrityConfig())
    for time in (1.0, 1.2, 1.4):
        assert not trial.passed(window_at(time, range(20)), agrees=True)
    assert trial.passed(window_at(1.8, [0, 1, 2, 3, 17]), agrees=True)
    assert not trial.failure


def test_a_trial_fails_when_lines_go_or_the_state_is_absurd():
    trial = Trial(start_with(range(6)), 1.0, IntegrityConfig())
    assert not trial.passed(window_at(1.0, range(6)), agrees=True)
    assert not trial.passed(window_at(1.3, [0, 1]), agrees=True)
    assert trial.failure == "4 of its 6 lines did not fit for long"
    fast = Trial(start_with(range(6)), 1.0, IntegrityConfig())
    assert not fast.passed(window_at(2.0, range(6), velocity=30.0), agrees=True)
    assert "implausible" in fast.failure


def test_a_trial_goes_on_until_lines_and_estimate_agree():
    """As lines on something that moves may for a while, and then fit no better."""
    late = Trial(start_with(range(6)), 1.0, IntegrityConfig(trial_time=0.7, lost_time=1.0))
    assert not late.passed(window_at(1.8, range(6)), agrees=False)
    assert not late.failure
    assert late.passed(window_at(2.2, range(6)), agrees=True)
    never = Trial(start_with(range(6)), 1.0, IntegrityConfig(trial_time=0.7, lost_time=1.0))
    assert not never.passed(window_at(2.6, range(6)), agrees=False)
    assert not never.failure
    assert not never.passed(window_at(2.8, range(6)), agrees=False)
    assert never.failure == "too many lines do not fit it"
