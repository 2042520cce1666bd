# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

from types import SimpleNamespace

import gtsam
import numpy as np
import pytest

from ruledgraph.backend.start import Start
from ruledgraph.backend.states import StateNode
from ruledgraph.core.config import Config, IntegrityConfig, StartConfig
from ruledgraph.segments.trial import Trial


def start_with(lines) -> Start:
    return Start(
        stamp=0,
        time=0.0,
        state=gtsam.NavState(gtsam.Pose3(), np.zeros(3)),
        bias=gtsam.imuBias.ConstantBias(),
        covariance=np.diag(np.square(np.repeat([1.0, 1.0, 1.0, 0.3, 0.1], 3))),
        lines=dict.fromkeys(lines),
    )


def window_at(time: float, lines, accelerometer=0.0, gyroscope=0.0):
    bias = gtsam.imuBias.ConstantBias([0.0, accelerometer, 0.0], [gyroscope, 0.0, 0.0])
    node = StateNode(1, time, gtsam.NavState(), bias, np.eye(15))
    return SimpleNamespace(newest=node, lines=dict.fromkeys(lines))


def passed(trial: Trial, window, lines_fit: bool) -> bool:
    trial.update(window, lines_fit)
    return trial.is_passed


def test_a_trial_is_passed_by_lines_that_stay():
    trial = Trial(start_with(range(6)), 1.0, Config())
    for time in (1.0, 1.2, 1.4):
        assert not passed(trial, window_at(time, range(20)), True)
    assert passed(trial, window_at(1.8, [0, 1, 2, 3, 17]), True)
    assert not trial.failure


def test_a_trial_fails_when_lines_go():
    trial = Trial(start_with(range(6)), 1.0, Config())
    assert not passed(trial, window_at(1.0, range(6)), True)
    assert not passed(trial, window_at(1.3, [0, 1]), True)
    assert trial.failure == "4 of its 6 lines were rejected"


@pytest.mark.parametrize(
    ("accelerometer", "gyroscope", "passes"),
    [
        (1.22, 0.0, True),
        (1.24, 0.0, False),
        (0.0, 0.4, True),
        (0.0, 0.42, False),
        (1.0, 0.3, False),
    ],
)
def test_a_trial_fails_when_biases_contradict_what_is_known_of_them_before_a_start(
    accelerometer, gyroscope, passes
):
    """Chi-square of six degrees of freedom: 99 % are below 16.81 (a table's), 4.1 sigma squared."""
    trial = Trial(start_with(range(6)), 1.0, Config(start=StartConfig(confidence=0.99)))
    assert passed(trial, window_at(2.0, range(6), accelerometer, gyroscope), True) == passes
    assert ("biases" in trial.failure) != passes


def test_a_trial_goes_on_until_lines_and_estimate_agree():
    """As lines on something that moves may for a while, and then fit no better."""
    config = Config(integrity=IntegrityConfig(trial_time=0.7, lost_time=1.0))
    late = Trial(start_with(range(6)), 1.0, config)
    assert not passed(late, window_at(1.8, range(6)), False)
    assert not late.failure
    assert passed(late, window_at(2.2, range(6)), True)
    never = Trial(start_with(range(6)), 1.0, config)
    assert not passed(never, window_at(2.6, range(6)), False)
    assert not never.failure
    assert not passed(never, window_at(2.8, range(6)), False)
    assert never.failure == "too many lines do not fit it"
