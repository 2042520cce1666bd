# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Frames and IMU samples with faults: handled, flagged and reported, or refused."""

import dataclasses
import itertools

import numpy as np
import pytest

from ruledgraph.core.errors import MeasurementError, RuledgraphError
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.live.stream_checks import ImuStream
from ruledgraph.odometry import Odometry
from small_runs import ate, run
from small_simulation import frames, small_simulation, small_stream


def test_a_covered_lens_is_flagged_and_handled():
    stream, calibration = small_stream()
    stamps = [frame.stamp for frame in frames(stream)]
    first, last = stamps[75], stamps[105]  # one second of black
    covered = [
        Frame(m.stamp, np.zeros_like(m.image))
        if isinstance(m, Frame) and first <= m.stamp <= last
        else m
        for m in stream
    ]
    odometry, live, _ = run(covered, calibration)
    statuses = {e.stamp: e.status for e in live}
    assert statuses[stamps[104]] == "dead reckoning"
    assert statuses[stamps[70]] == "tracking"
    assert live[-1].status == "tracking"
    assert live[-1].lines >= 4
    assert len(live) > 0.7 * len(stamps)
    assert ate(live, small_simulation()) < 0.1  # a second by the IMU alone
    assert odometry.recoveries == []


def test_blank_frames_never_start_and_never_crash():
    stream, calibration = small_stream(moving=True)
    blank = [
        Frame(m.stamp, np.full_like(m.image, 40)) if isinstance(m, Frame) else m for m in stream
    ]
    odometry, live, _ = run(blank, calibration)
    assert live == []
    assert any("0 lines were followed long enough, 2 are" in text for text in odometry.warnings)


@pytest.mark.parametrize("rate", [10.0, 15.0])
def test_low_frame_rates(rate):
    stream, calibration = small_stream()
    keep = {frame.stamp for frame in frames(stream)[:: round(30.0 / rate)]}
    thinned = [m for m in stream if not isinstance(m, Frame) or m.stamp in keep]
    _, live, _ = run(thinned, calibration)
    assert len(live) > 0.6 * len(keep)
    assert ate(live, small_simulation()) < 0.03


def test_dropped_and_repeated_frames():
    stream, calibration = small_stream()
    rng = np.random.default_rng(0)
    dropped = [m for m in stream if not isinstance(m, Frame) or rng.uniform() > 0.3]
    repeated = list(
        itertools.chain.from_iterable([m, m] if isinstance(m, Frame) else [m] for m in dropped)
    )
    _, live, _ = run(repeated, calibration)
    assert ate(live, small_simulation()) < 0.03
    assert len({e.stamp for e in live}) == len(live)


def test_frames_of_another_size_are_refused():
    _, calibration = small_stream()
    with pytest.raises(RuledgraphError, match="a frame is 64x48, but the calibration is for 320x"):
        Odometry(calibration).add_image(Frame(0, np.zeros((48, 64), np.uint8)))


@pytest.mark.parametrize(
    ("image", "fault"),
    [
        (np.zeros((240, 320, 3), np.uint8), r"shape \(240, 320, 3\); convert images to grey"),
        (np.zeros((240, 320), np.uint16), "is uint16; convert images to 8 bit"),
        (np.zeros((240, 320), np.float32), "is float32; convert images to 8 bit"),
    ],
)
def test_images_that_are_not_grey_of_8_bit_are_refused_when_they_are_added(image, fault):
    _, calibration = small_stream()
    odometry = Odometry(calibration)
    odometry.prefetch(Frame(0, image))
    with pytest.raises(RuledgraphError, match=fault):
        odometry.add_image(Frame(0, image))


def off_by_sigmas(live: list[Estimate], simulation) -> np.ndarray:
    """Errors of the positions over three sigmas, where the first estimate says the world is."""
    true = simulation.truth(np.array([e.stamp for e in live]))
    turn = live[0].world_T_body.rotation().matrix() @ true.rotation[0].T
    yaw = np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    R = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    found = []
    for e, place in zip(live, true.position - true.position[0], strict=True):
        error = e.world_T_body.translation() - live[0].world_T_body.translation() - R @ place
        error = e.world_T_body.rotation().matrix().T @ error
        covariance = e.covariances[0][3:, 3:] + np.eye(3) * 0.01**2
        found.append(np.sqrt(error @ np.linalg.solve(covariance, error)) / 3.0)
    return np.array(found)


@pytest.mark.parametrize("frozen", [False, True], ids=["silent", "frozen"])
def test_a_hole_of_the_imu_is_bridged_and_shows_in_the_covariance(frozen):
    stream, calibration = small_stream()
    stamps = [m.stamp for m in stream if isinstance(m, ImuSample)]
    start, stop = stamps[int(0.6 * len(stamps))], stamps[int(0.68 * len(stamps))]
    cut, last = [], None
    for m in stream:
        if isinstance(m, ImuSample) and start < m.stamp < stop:
            if frozen:
                cut.append(last._replace(stamp=m.stamp))
            continue
        last = m if isinstance(m, ImuSample) else last
        cut.append(m)
    odometry, live, _ = run(cut, calibration)
    assert sum("the IMU was frozen at" in warning for warning in odometry.warnings) == frozen
    assert ate(live, small_simulation()) < 0.05
    assert off_by_sigmas(live, small_simulation()).max() < 1.0


def test_spikes_of_the_imu_are_replaced_and_counted():
    stream, calibration = small_stream()
    rng = np.random.default_rng(0)
    spiked, count = [], 0
    for i, m in enumerate(stream):
        if isinstance(m, ImuSample) and i > 100 and rng.random() < 0.01:
            rate, force = rng.normal(size=(2, 3)) * [[3.0], [30.0]]
            m = ImuSample(m.stamp, m.gyroscope + rate, m.accelerometer + force)
            count += 1
        spiked.append(m)
    odometry, live, _ = run(spiked, calibration)
    (warning,) = odometry.warnings
    assert "the IMU spikes at" in warning
    assert f"({count} times)" in warning
    assert ate(live, small_simulation()) < 0.02  # as without


def test_a_saturated_imu_is_reported_and_flagged():
    stream, calibration = small_stream()
    clipped = [
        m._replace(gyroscope=np.clip(m.gyroscope, -0.2, 0.2)) if isinstance(m, ImuSample) else m
        for m in stream
    ]
    odometry, live, _ = run(clipped, calibration)
    assert any("the gyroscope's" in w and "ends at" in w for w in odometry.warnings)
    assert sum(e.status == "degraded" for e in live) > 0.2 * len(live)
    assert ate(live, small_simulation()) < 0.1


def test_a_frozen_camera_is_reported_and_not_used():
    stream, calibration = small_stream()
    stamps = [frame.stamp for frame in frames(stream)]
    first, last = stamps[75], stamps[105]
    frozen, image = [], None
    for m in stream:
        if isinstance(m, Frame) and first <= m.stamp <= last:
            m = Frame(m.stamp, image)
        image = m.image if isinstance(m, Frame) else image
        frozen.append(m)
    odometry, live, _ = run(frozen, calibration)
    assert sum("the camera is frozen" in warning for warning in odometry.warnings) == 1
    assert {e.stamp: e.status for e in live}[stamps[104]] == "dead reckoning"
    assert live[-1].status == "tracking"
    assert off_by_sigmas(live, small_simulation()).max() < 1.0


def test_frames_that_come_late_are_reported_once():
    stream, calibration = small_stream()
    measurements = list(stream)
    for i, m in enumerate(measurements):
        if isinstance(m, Frame) and i % 5 == 0:
            later = next(k for k in range(i + 1, len(stream)) if isinstance(stream[k], Frame))
            measurements[i], measurements[later] = measurements[later], measurements[i]
            if i > len(stream) // 4:
                break
    odometry, _, _ = run(measurements, calibration)
    assert sum("came after a later one" in warning for warning in odometry.warnings) == 1


@pytest.mark.parametrize(("missing", "starts"), [(0.055, True), (0.2, False)])
def test_a_start_in_motion_across_short_holes_of_the_imu(missing, starts):
    measurements, calibration = small_stream(moving=True)
    first = measurements[0].stamp
    kept = (
        m for m in measurements if isinstance(m, Frame) or (m.stamp - first) * 1e-9 % 0.7 >= missing
    )
    odometry, live, _ = run(kept, calibration)
    assert bool(live) == starts
    reason = "IMU samples are missing or clipped"
    assert any(reason in warning for warning in odometry.warnings) != starts
    assert starts or reason in odometry.status


def test_a_frame_that_the_imu_has_reached_is_processed_at_once():
    measurements, calibration = small_stream()
    late = dataclasses.replace(calibration, time_offset=-0.1, time_offset_exact=True)
    odometry = Odometry(late)
    count = 0
    for measurement in measurements:
        odometry.add(measurement)
        found = odometry.take_live()
        count += len(found)
        if found:
            assert isinstance(measurement, Frame)
            assert found[-1].stamp == measurement.stamp
    assert count


def test_an_imu_sample_with_a_stamp_far_ahead_is_dropped():
    measurements, calibration = small_stream()
    wrong = [m for m in measurements if isinstance(m, ImuSample)][300]
    ahead = wrong._replace(stamp=wrong.stamp + 3600 * 10**9)
    changed = [ahead if m is wrong else m for m in measurements]
    odometry, live, _ = run(changed, calibration)
    assert [w for w in odometry.warnings if "was stamped far ahead of it" in w]
    assert live[-1].stamp > wrong.stamp + 10**9
    assert ate(live, small_simulation()) < 0.02


def test_a_live_stream_waits_for_another_sample_as_far_ahead():
    checks, sample = ImuStream(), ImuSample(0, np.zeros(3), np.array([0.0, 0.0, 9.81]))
    hour = 3600 * 10**9
    for stamp in (0, 5 * 10**6, hour, 10**7, 15 * 10**6, hour, hour + 5 * 10**6):
        checks.add(sample._replace(stamp=stamp))
    with pytest.raises(MeasurementError, match="not in order of time"):
        checks.add(sample._replace(stamp=2 * 10**7))
