# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import gtsam
import numpy as np
import pytest
from scipy.stats import chi2

from ruledgraph.backend.states import StateNode
from ruledgraph.core.config import Config, IntegrityConfig, StartConfig


def node_with(velocity=0.0, accelerometer=0.0, gyroscope=0.0) -> StateNode:
    state = gtsam.NavState(gtsam.Pose3(), np.array([velocity, 0.0, 0.0]))
    bias = gtsam.imuBias.ConstantBias([0.0, accelerometer, 0.0], [gyroscope, 0.0, 0.0])
    return StateNode(1, 0.0, state, bias, np.eye(15))


CONFIG = Config(
    start=StartConfig(accelerometer_bias=0.2, gyroscope_bias=0.05),
    integrity=IntegrityConfig(max_speed=20.0, confidence=0.99),
)
# Of six biases, in standard deviations.
MOST = float(np.sqrt(chi2.ppf(0.99, 6)))


def test_a_state_is_plausible_within_its_speed_and_biases():
    assert node_with().is_plausible(CONFIG)
    assert node_with(velocity=19.9).is_plausible(CONFIG)
    assert not node_with(velocity=20.1).is_plausible(CONFIG)
    assert not node_with(velocity=np.nan).is_plausible(CONFIG)


@pytest.mark.parametrize("times", [0.99, 1.01])
def test_biases_are_tested_together_by_what_is_known_before_a_start(times):
    most = times * MOST
    plausible = times < 1.0
    assert node_with(accelerometer=0.2 * most).is_plausible(CONFIG) == plausible
    assert node_with(gyroscope=-0.05 * most).is_plausible(CONFIG) == plausible
    share = np.sqrt(0.5) * most
    both = node_with(accelerometer=0.2 * share, gyroscope=0.05 * share)
    assert both.is_plausible(CONFIG) == plausible
    assert both.has_unlikely_biases(CONFIG.start.bias_sigmas, 0.99) != plausible


def test_biases_that_are_no_number_are_unlikely():
    assert node_with(accelerometer=np.nan).has_unlikely_biases(CONFIG.start.bias_sigmas, 0.99)
