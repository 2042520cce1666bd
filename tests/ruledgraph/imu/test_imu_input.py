# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from ruledgraph.core.config import ImuConfig
from ruledgraph.core.measurements import Gap, ImuSample
from ruledgraph.core.messages import Messages
from ruledgraph.imu.imu_input import ImuInput

STEP = 5_000_000


@pytest.mark.parametrize("jump", [0.0, 20.0])
def test_an_imu_that_was_frozen_for_long_leaves_a_gap(jump):
    """Also where the first new reading is so far from the last that it may be a spike."""
    rng, imu = np.random.default_rng(0), ImuInput(Messages(), ImuConfig())
    gaps = []
    for i in range(1000):
        frozen = 400 <= i < 900
        if not frozen:
            gyroscope, accelerometer = rng.normal(scale=0.01, size=(2, 3))
            accelerometer[2] += 9.81 + (jump if i >= 900 else 0.0)
        gap = imu.add(1e-9 * i * STEP, ImuSample(i * STEP, gyroscope, accelerometer))
        if gap:
            gaps.append(gap)
            imu.clear()
    assert gaps == [Gap(399 * STEP, 900 * STEP)]
