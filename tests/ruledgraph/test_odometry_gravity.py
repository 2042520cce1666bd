# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The odometry where gravity is not 9.81 m/s^2."""

from collections.abc import Sequence

import numpy as np
import pytest

from ruledgraph.core.estimates import Estimate
from ruledgraph.core.settings import load_config
from ruledgraph.simulation import Simulation
from ruledgraph.simulation import imu as simulated_imu
from small_runs import ate, ever_degraded, run
from small_simulation import new_small_simulation


@pytest.mark.parametrize(
    ("moving", "readout"), [(False, 0.02), (True, 0.0)], ids=["from rest, rolling", "in motion"]
)
def test_gravity_is_the_one_that_is_set(
    moving: bool, readout: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twice that of the earth: used in one place only, 9.81 would spoil the estimate."""
    found = []
    for gravity in (9.81, 20.0):
        simulation = simulated(gravity, moving, readout, monkeypatch)
        live, smoothed = estimates(simulation, gravity)
        assert not ever_degraded(live)
        errors = ate(live, simulation), ate(smoothed, simulation), speed_error(smoothed, simulation)
        found.append((len(live), *errors))
    earth, twice = found
    assert twice[0] > 0.95 * earth[0]
    # As on earth: by half more, and 0.3 mm, two seeds of one motion differ anyway.
    assert twice[1] < 1.5 * earth[1] + 0.3e-3
    assert twice[2] < 1.5 * earth[2] + 0.3e-3
    # Within an interval of 0.2 s a gravity off by 10 m/s^2 would make metres per second of it.
    assert twice[3] < 1.5 * earth[3] + 1e-3


def test_the_accelerometers_bias_takes_up_a_small_difference(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Recorded at a pole."""
    simulation = simulated(9.832, False, 0.0, monkeypatch)
    known, _ = estimates(simulation, 9.832)
    unknown, _ = estimates(simulation, 9.81)
    # 1.5 times, and 0.3 mm, as above.
    assert ate(unknown, simulation) < 1.5 * ate(known, simulation) + 0.3e-3
    upwards = [
        last.world_T_body.rotation().rotate(last.bias.accelerometer())[2]
        for last in (known[-1], unknown[-1])
    ]
    # The bias is known to some 5 mm/s^2, of one recording with the same noise to a fifth of it.
    np.testing.assert_allclose(upwards[1] - upwards[0], 0.022, atol=0.003)


def simulated(
    gravity: float, moving: bool, readout: float, monkeypatch: pytest.MonkeyPatch
) -> Simulation:
    monkeypatch.setattr(simulated_imu, "STANDARD_GRAVITY", (0.0, 0.0, -gravity))
    return new_small_simulation(1, moving, readout=readout)


def speed_error(found: Sequence[Estimate], simulation: Simulation) -> float:
    """Root mean square, m/s: velocities but for the heading, which differs between the worlds."""
    true = simulation.truth(np.array([estimate.stamp for estimate in found])).velocity
    own = np.array([estimate.velocity for estimate in found])
    speeds, true_speeds = (np.linalg.norm(velocity, axis=1) for velocity in (own, true))
    return float(np.sqrt(np.mean((speeds - true_speeds) ** 2)))


def estimates(
    simulation: Simulation, gravity: float
) -> tuple[Sequence[Estimate], Sequence[Estimate]]:
    config = load_config(None, [f"imu.gravity={gravity}"])
    _, live, smoothed = run(simulation.stream(), simulation.calibration, config)
    return live, smoothed
