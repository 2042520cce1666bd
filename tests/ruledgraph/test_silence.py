# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Sensors that stop, freeze, or are stamped in another unit, fed to `Odometry` itself."""

import dataclasses
import tracemalloc
from collections.abc import Iterable, Iterator

import numpy as np
import pytest

from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame, ImuSample, Measurement
from ruledgraph.odometry import Odometry
from ruledgraph.simulation import simulate
from small_simulation import SMALL, frames, small_stream

MOVING = 3_000_000_000
"""ns after its first measurement the small recording is in motion."""
W, A = np.zeros(3), np.array([0.0, 0.0, 9.81])


def started() -> tuple[Odometry, int]:
    """An odometry that has tracked the small recording for a while, and the time, ns."""
    stream, calibration = small_stream()
    odometry, stop = Odometry(calibration), stream[0].stamp + MOVING
    for measurement in stream:
        if measurement.stamp <= stop:
            odometry.add(measurement)
    assert odometry.status == "tracking"
    return odometry, stop


def goes_on(
    after: int, seconds: float, imu: str = "runs", camera: bool = True
) -> Iterator[Measurement]:
    """Sensors from a time (ns) on: an IMU that runs, is frozen or dead, and a camera at 33 Hz."""
    stream, _ = small_stream()
    rng = np.random.default_rng(0)
    last = next(m for m in stream if isinstance(m, ImuSample) and m.stamp >= after)
    images = [frame.image for frame in frames(stream)]
    for i in range(1, int(200 * seconds) + 1):
        stamp = after + 5_000_000 * i
        noise = rng.normal(size=(2, 3)) * 0.01 if imu == "runs" else np.zeros((2, 3))
        if imu != "dead":
            yield ImuSample(stamp, last.gyroscope + noise[0], last.accelerometer + noise[1])
        if camera and i % 6 == 0:
            yield Frame(stamp + 1_000_000, images[i // 6 % len(images)].copy())


def add_all(odometry: Odometry, measurements: Iterable[Measurement]) -> None:
    for measurement in measurements:
        odometry.add(measurement)


def memory_after(odometry: Odometry, measurements: Iterator[Measurement], seconds: float) -> int:
    """Bytes that are added while they are taken in, but for the first so many seconds."""
    first: int | None = None
    before = 0
    tracemalloc.start()
    try:
        for m in measurements:
            odometry.add(m)
            odometry.take_live(), odometry.take_smoothed(), odometry.take_lines()
            first = m.stamp if first is None else first
            if not before and m.stamp - first > seconds * 1e9:
                before = tracemalloc.get_traced_memory()[0]
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("imu", ["dead", "frozen"])
def test_an_imu_that_stops_is_reported_and_memory_stays_flat(imu):
    odometry, stop = started()
    # An image has 77 kB: all that come in the 12 s would be 30 MB.
    assert memory_after(odometry, goes_on(stop, 20.0, imu), 8.0) < 1_000_000
    assert odometry.status == "waiting for IMU"
    text = "no IMU samples since" if imu == "dead" else "the IMU has been frozen since"
    assert sum(text in warning for warning in odometry.warnings) == 1
    assert sum("images are dropped" in warning for warning in odometry.warnings) == 1


def test_a_camera_that_stops_is_reported_and_memory_stays_flat():
    odometry, stop = started()
    live = len(odometry.take_live())
    smoothed = len(odometry.take_smoothed())
    # 200 samples a second of some 300 bytes: all that come in the 12 s would be 0.7 MB.
    assert memory_after(odometry, goes_on(stop, 20.0, camera=False), 8.0) < 100_000
    assert odometry.status == "waiting for images"
    assert sum("no frame for" in warning for warning in odometry.warnings) == 1
    assert odometry.window is None
    assert live > smoothed


def test_what_was_tracked_before_a_silence_is_all_handed_out_smoothed():
    odometry, stop = started()
    for measurement in goes_on(stop, 10.0, camera=False):
        odometry.add(measurement)
    stamps = [estimate.stamp for estimate in odometry.take_live()]
    assert [estimate.stamp for estimate in odometry.take_smoothed()] == stamps
    odometry.finish()
    assert odometry.take_smoothed() == []


@pytest.mark.parametrize("silent", ["IMU", "camera", "frozen IMU"])
def test_it_starts_again_after_a_long_silence(silent):
    odometry, stop = started()
    live = {"imu": "dead"} if silent == "IMU" else {"camera": False}
    for measurement in goes_on(stop, 8.0, **({"imu": "frozen"} if "frozen" in silent else live)):
        odometry.add(measurement)
    odometry.take_live()
    stream, _ = small_stream()
    later = stop + 9_000_000_000 - stream[0].stamp
    for m in stream:
        if isinstance(m, Frame):
            odometry.add(Frame(m.stamp + later, m.image))
        else:
            odometry.add(m._replace(stamp=m.stamp + later))
    found = odometry.take_live()
    assert {estimate.segment for estimate in found} == {1}
    assert len(found) > 60
    assert odometry.status == "tracking"


def test_the_status_before_the_start():
    _, calibration = small_stream()
    rng = np.random.default_rng(0)
    odometry = Odometry(calibration)
    assert odometry.status == "waiting for IMU"
    odometry.add(ImuSample(0, W, A))
    assert odometry.status == "waiting for images"
    for i in range(1, 300):
        odometry.add(ImuSample(5_000_000 * i, rng.normal(size=3), rng.normal(size=3) + A))
        if i % 6 == 0:
            odometry.add(Frame(5_000_000 * i, np.full((240, 320), i % 250, np.uint8)))
        if i == 12:
            assert odometry.status == "initializing: no attempt to start yet"
    assert odometry.status.startswith("initializing: 0 lines")


def test_a_frozen_imu_from_the_beginning():
    _, calibration = small_stream()
    odometry = Odometry(calibration)
    for m in goes_on(0, 6.0, "frozen"):
        odometry.add(m)
    assert odometry.status == "waiting for IMU"
    assert any("the IMU has been frozen since" in warning for warning in odometry.warnings)


def test_a_noiseless_imu_at_rest_is_not_frozen():
    simulation = simulate(
        "noncoplanar_cluttered", "free", calibration=SMALL, rate=30.0, duration=4.0, imu=None
    )
    odometry = Odometry(simulation.calibration)
    for measurement in simulation.stream():
        odometry.add(measurement)
    assert not any("frozen" in warning for warning in odometry.warnings)
    live = odometry.take_live()
    # It starts at rest, within the second of rest.
    assert (live[0].stamp - simulation.epoch) * 1e-9 < 0.6
    # Once the biases are known, but for a frame or two in which the rest may go on or not.
    settled = [e for e in live if e.stamp > live[0].stamp + 500_000_000]
    assert sum(e.status == "degraded" for e in settled) <= 2
    assert len(live) > 90


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_samples_that_are_not_finite_are_left_out_with_one_warning(number):
    stream, calibration = small_stream()
    odometry, count = Odometry(calibration), 0
    for m in stream:
        odometry.add(m)
        if isinstance(m, ImuSample) and (m.stamp // 5_000_000) % 10 == 0:
            bad = m.accelerometer.copy()
            bad[count % 3] = number
            odometry.add(m._replace(stamp=m.stamp + 2_000_000, accelerometer=bad))
            count += 1
    expected, _ = started()
    (warning,) = odometry.warnings
    assert "not finite" in warning
    assert f"({count} times)" in warning
    # As if there were none.
    live, same = odometry.take_live(), expected.take_live()
    for one, other in zip(live, same, strict=False):
        np.testing.assert_array_equal(one.matrix, other.matrix)


@pytest.mark.parametrize(
    ("unit", "match"),
    [
        (lambda ns: ns * 1e-9, "no whole number of nanoseconds"),
        (lambda ns: ns // 1_000, "IMU samples come 5000 ns apart"),
        (lambda ns: ns // 1_000_000, "IMU samples come 5 ns apart"),
        (lambda ns: ns // 1_000_000_000, "IMU samples come 0 ns apart"),
        (lambda ns: ns * 1_000, "IMU samples come 5 s apart"),
        (lambda ns: ns * 1_000_000_000, "not within 0 to 2"),
    ],
    ids=["float seconds", "us", "ms", "s", "ps", "ns as s"],
)
def test_stamps_of_the_imu_in_another_unit_are_refused(unit, match):
    odometry = Odometry(small_stream()[1])
    start = 1_700_000_000 * 10**9 if match != "IMU samples come 5 s apart" else 0
    forces = A + np.random.default_rng(0).normal(scale=0.01, size=(200, 3))
    samples = [ImuSample(unit(start + 5_000_000 * i), W, force) for i, force in enumerate(forces)]
    with pytest.raises(RuledgraphError, match=match) as error:
        add_all(odometry, samples)
    assert "\n" not in str(error.value)
    assert "nanoseconds" in str(error.value)


@pytest.mark.parametrize(
    ("unit", "match"),
    [
        (lambda ns: ns * 1e-9, "no whole number of nanoseconds"),
        (lambda ns: ns // 1_000, "images come 33000 ns apart"),
        (lambda ns: ns // 1_000_000, "images come 33 ns apart"),
    ],
    ids=["float seconds", "us", "ms"],
)
def test_stamps_of_images_in_another_unit_are_refused(unit, match):
    odometry = Odometry(small_stream()[1])
    image = np.zeros((240, 320), np.uint8)
    images = [Frame(unit(1_700_000_000 * 10**9 + 33_000_000 * i), image) for i in range(60)]
    with pytest.raises(RuledgraphError, match=match):
        add_all(odometry, images)


@pytest.mark.parametrize("shift", [-1000.0, 1000.0])
def test_clocks_without_a_common_base_are_reported(shift):
    odometry = Odometry(small_stream()[1])
    for m in goes_on(2_000 * 10**9, 4.0):
        if isinstance(m, Frame):
            m = Frame(m.stamp + round(shift * 1e9), m.image)
        odometry.add(m)
    waits = "images" if shift < 0.0 else "IMU"
    assert odometry.status == f"waiting for {waits}"
    assert any("check that their clocks and units are the same" in w for w in odometry.warnings)


def test_samples_that_come_late_are_reported_and_change_nothing():
    stream, calibration = small_stream()
    odometry, expected = Odometry(calibration), Odometry(calibration)
    last = None
    for m in stream:
        expected.add(m)
        odometry.add(m)
        if isinstance(m, ImuSample):
            if last is not None and m.stamp % 50_000_000 == 0:
                odometry.add(last._replace(gyroscope=last.gyroscope + 1.0))
            last = m
    (warning,) = odometry.warnings
    assert "came after one at" in warning
    for one, other in zip(odometry.take_live(), expected.take_live(), strict=True):
        np.testing.assert_array_equal(one.matrix, other.matrix)


def test_a_sample_of_another_shape_is_refused():
    odometry = Odometry(small_stream()[1])
    with pytest.raises(RuledgraphError, match="3 numbers"):
        odometry.add_imu(ImuSample(0, np.zeros(4), A))


def test_frames_wait_for_an_imu_that_is_late_as_a_known_offset_wants():
    """A large offset between the clocks makes frames wait: these are not dropped."""
    stream, calibration = small_stream()
    expected, _ = started()
    shifted = [Frame(m.stamp - 5 * 10**9, m.image) if isinstance(m, Frame) else m for m in stream]
    shifted.sort(key=lambda m: m.stamp)
    odometry = Odometry(dataclasses.replace(calibration, time_offset=5.0))
    for m in shifted:
        odometry.add(m)
    assert not any("dropped" in warning for warning in odometry.warnings)
    assert len(odometry.take_live()) > len(expected.take_live())
