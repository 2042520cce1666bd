# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The odometry with a rolling shutter's images."""

import re
from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest

from ruledgraph.core.config import ImuConfig
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import Frame, Measurement
from ruledgraph.diagnostics.extrinsics_check import check_rotation
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.propagation import state_before
from ruledgraph.segments.rows import motion_about
from ruledgraph.simulation import Simulation, make_scene, simulate
from ruledgraph.simulation import imu as simulated_imu
from small_runs import ate, ever_degraded, run
from small_simulation import SMALL, new_small_simulation

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("rolling shutter")

READOUT = 0.025


@cache
def recorded(readout: float, moving: bool) -> tuple[Simulation, tuple[Measurement, ...]]:
    """Hand-held before a cluttered wall, 30 frames a second."""
    simulation = new_small_simulation(1, moving, readout=readout)
    return simulation, tuple(simulation.stream())


@cache
def estimates(readout: float, known: float, moving: bool) -> tuple[list[Estimate], list[Estimate]]:
    """Live and smoothed, of a readout, when another one is given."""
    simulation, stream = recorded(readout, moving)
    _, live, smoothed = run(stream, simulation.calibration.with_readout(known))
    return live, smoothed


@pytest.mark.parametrize("moving", [False, True], ids=["from rest", "in motion"])
def test_a_known_readout_costs_no_accuracy(moving: bool) -> None:
    """Poses are those at the stamps, which are the first rows': in the simulation's truth, too."""
    simulation, _ = recorded(READOUT, moving)
    live, smoothed = estimates(READOUT, READOUT, moving)
    plain_live, plain_smoothed = estimates(0.0, 0.0, moving)
    assert len(live) > 0.95 * len(plain_live)
    # As a global shutter's: by half more, and 0.3 mm, two seeds of one motion differ anyway.
    assert ate(live, simulation) < 1.5 * ate(plain_live, simulation) + 0.3e-3
    assert ate(smoothed, simulation) < 1.5 * ate(plain_smoothed, simulation) + 0.3e-3
    assert not ever_degraded(live)
    # Ignored it costs several times the error: 3 and 6 times here.
    ignored, _ = estimates(READOUT, 0.0, moving)
    assert len(ignored) < 10 or ate(ignored, simulation) > 2.0 * ate(live, simulation)


def test_poses_and_velocities_are_of_the_stamps() -> None:
    """Not of the middle row, 12.5 ms later: at 0.5 m/s that is 6 mm along the way."""
    simulation, _ = recorded(READOUT, False)
    for own in estimates(READOUT, READOUT, False):
        moving = [e for e in own if np.linalg.norm(e.velocity) > 0.2]
        stamps = np.array([e.stamp for e in moving])
        velocities = np.array([e.velocity for e in moving])
        errors = {}
        for shift in (0, 12_500_000):
            truth = simulation.truth(stamps + shift)
            # Both worlds have z upwards; speeds do not depend on the heading.
            speeds = [np.linalg.norm(v, axis=1) for v in (velocities, truth.velocity)]
            errors[shift] = np.sqrt(np.mean((speeds[0] - speeds[1]) ** 2))
        assert errors[0] < 0.5 * errors[12_500_000]


def filled(simulation: Simulation, gravity: float = 9.81) -> ImuBuffer:
    imu = ImuBuffer(ImuConfig(gravity=gravity))
    for sample in simulation.imu.samples():
        imu.append((sample.stamp - simulation.epoch) * 1e-9, sample.gyroscope, sample.accelerometer)
    return imu


def ideal(gravity: float = 9.81) -> tuple[Simulation, ImuBuffer]:
    scene = make_scene("square", 0)
    simulation = simulate(
        scene, "free", calibration=SMALL.with_readout(0.03), rate=30.0, imu=None, imu_rate=1000.0
    )
    return simulation, filled(simulation, gravity)


def true_state(simulation: Simulation, time: float) -> gtsam.NavState:
    motion = simulation.motion
    return gtsam.NavState(motion.pose(time), motion.velocity(time))


@pytest.mark.parametrize("gravity", [9.81, 20.0])
def test_row_motion_is_that_of_the_true_camera(
    gravity: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated_imu, "STANDARD_GRAVITY", (0.0, 0.0, -gravity))
    simulation, imu = ideal(gravity)
    calibration, bias = simulation.calibration, gtsam.imuBias.ConstantBias()
    time = 3.21
    rows = motion_about(calibration, imu, time, true_state(simulation, time), bias)
    middle = simulation.motion.pose(time) * calibration.body_T_cam
    for t, turn, position in zip(rows.times, rows.turns, rows.positions, strict=True):
        true = middle.between(simulation.motion.pose(time + t) * calibration.body_T_cam)
        np.testing.assert_allclose(turn, gtsam.Rot3.Logmap(true.rotation()), atol=1e-6)
        np.testing.assert_allclose(position, true.translation(), atol=1e-6)
    assert rows.times[[0, -1]] == pytest.approx([-0.015, 0.015])
    # Before a start the gyroscope alone.
    blind = motion_about(calibration, imu, time, None, bias)
    assert blind.positions is None
    np.testing.assert_allclose(blind.turns, rows.turns, atol=1e-9)


def test_a_state_is_carried_back() -> None:
    simulation, imu = ideal()
    found = state_before(imu, true_state(simulation, 4.0), gtsam.imuBias.ConstantBias(), 4.0, 0.015)
    true = true_state(simulation, 3.985)
    assert found.pose().equals(true.pose(), 1e-6)
    np.testing.assert_allclose(found.velocity(), true.velocity(), atol=1e-5)


def test_images_faster_than_their_readout_are_refused() -> None:
    _, stream = recorded(0.0, False)
    calibration = SMALL.with_readout(0.04)
    with pytest.raises(RuledgraphError, match=r"33.3 ms apart, but the rows .* within 40.0 ms"):
        run(stream, calibration)
    # A few that come early are no reason: 20 ms, once in a while.
    frames = [m for m in stream if isinstance(m, Frame)]
    early = {f.stamp: replace(f, stamp=f.stamp - 13_000_000) for f in frames[5:40:5]}
    jittery = [early.get(m.stamp, m) if isinstance(m, Frame) else m for m in stream]
    jittery.sort(key=lambda m: m.stamp)
    run(jittery[:400], SMALL.with_readout(0.03))


def test_info_notices_another_readout_than_the_calibrations() -> None:
    """By how images and gyroscope turn; before one wall it is good to some 8 ms."""

    def told(readout: float, given: float) -> list[float]:
        simulation, stream = recorded(readout, False)
        findings = check_rotation(stream, simulation.calibration.with_readout(given))
        texts = [
            re.search(r"rows read within (\d+) ± \d+ ms", finding.text) for finding in findings
        ]
        return [float(found[1]) for found in texts if found]

    (estimated,) = told(READOUT, 0.0)
    assert estimated == pytest.approx(1e3 * READOUT, abs=8.0)
    assert told(READOUT, READOUT) == told(0.0, 0.0) == []
    (too_much,) = told(0.0, READOUT)
    assert too_much < 8.0


@pytest.mark.parametrize("readout", [0.0, READOUT])
def test_a_readout_of_which_the_calibration_says_nothing(readout: float) -> None:
    """It is found, and used from then on; of a global shutter nothing changes."""
    simulation = new_small_simulation(1, True, duration=9.0, readout=readout)
    stream = tuple(simulation.stream())
    unknown = replace(simulation.calibration, line_delay=None)
    odometry, live, _ = run(stream, unknown)
    ignoring, plain, _ = run(stream, unknown.with_readout(0.0))
    found = odometry.calibration_search.readout.found
    told = [w for w in map(str, odometry.warnings) if "rolling shutter: readout" in w]
    assert ignoring.calibration_search.readout.found is None
    if not readout:
        assert found is None
        assert not told
        assert [e.position.tolist() for e in live] == [e.position.tolist() for e in plain]
        return
    assert found is not None
    assert len(told) == 1
    value, sigma = found
    assert value == pytest.approx(readout, abs=3.0 * sigma)
    assert sigma < 0.005
    # The stamps, of the first rows, count as those of the middle rows, of which the poses are.
    late = round(0.5e9 * readout)
    last = [[e for e in own if e.stamp > live[-1].stamp - 3_000_000_000] for own in (live, plain)]
    assert min(len(own) for own in last) > 60
    # From the start on, for which frames were processed anew: 0.9 and 8.6 mm in its first 2 s.
    for both in ([live[:60], plain[:60]], last):
        of_found, of_plain = (ate_at(own, simulation, late) for own in both)
        assert of_found < 0.5 * of_plain


def ate_at(estimates: list[Estimate], simulation: Simulation, late: int) -> float:
    """As `ate`, of poses so much later (ns) than their stamps."""
    return ate([replace(e, stamp=e.stamp + late) for e in estimates], simulation)
