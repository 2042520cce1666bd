# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import gtsam
import numpy as np
import pytest

from ruledgraph.backend.states import StateNode
from ruledgraph.core.config import IntegrityConfig

LIMITS = IntegrityConfig(max_speed=20.0, max_gyroscope_bias=0.2, max_accelerometer_bias=1.0)


@pytest.mark.parametrize(
    ("velocity", "accelerometer", "gyroscope", "plausible"),
    [
        (0.0, 0.0, 0.0, True),
        (19.9, 0.99, 0.19, True),
        (20.1, 0.0, 0.0, False),
        (0.0, 1.01, 0.0, False),
        (0.0, 0.0, 0.21, False),
        (np.nan, 0.0, 0.0, False),
        (0.0, np.nan, 0.0, False),
    ],
)
def test_a_state_is_plausible_within_its_limits(velocity, accelerometer, gyroscope, plausible):
    state = gtsam.NavState(gtsam.Pose3(), np.array([velocity, 0.0, 0.0]))
    bias = gtsam.imuBias.ConstantBias([0.0, accelerometer, 0.0], [gyroscope, 0.0, 0.0])
    assert StateNode(1, 0.0, state, bias, np.eye(15)).is_plausible(LIMITS) == plausible
