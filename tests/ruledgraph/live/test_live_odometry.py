# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Live odometry as programs use it: two sensors' threads, callbacks, silences, overload."""

import logging
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

import ruledgraph
from ruledgraph.core.errors import MeasurementError, RuledgraphError
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.live import LiveOdometry
from ruledgraph.odometry import Odometry
from small_simulation import frames, small_stream

W, A = (0.0, 0.0, 0.0), (0.0, 0.0, 9.81)


def feed(live: LiveOdometry, measurement: Frame | ImuSample) -> None:
    if isinstance(measurement, Frame):
        live.add_image(measurement.image, t_ns=measurement.stamp)
    else:
        live.add_imu(measurement.gyroscope, measurement.accelerometer, t_ns=measurement.stamp)


def feed_patiently(live: LiveOdometry, measurements) -> None:
    """Without overload."""
    for measurement in measurements:
        feed(live, measurement)
        while live.waiting > 8:
            time.sleep(0.001)


def until(condition: Callable[[], bool], seconds: float = 10.0) -> bool:
    stop = time.monotonic() + seconds
    while not condition() and time.monotonic() < stop:
        time.sleep(0.002)
    return condition()


def test_it_is_what_the_package_offers():
    assert ruledgraph.LiveOdometry is LiveOdometry


def test_two_threads_get_what_a_recording_gives():
    stream, calibration = small_stream()
    odometry, expected, smoothed, lines = Odometry(calibration), [], [], []
    for measurement in stream:
        odometry.add(measurement)
        expected += odometry.take_live()
    odometry.finish()
    expected += odometry.take_live()

    poses, threads = [], set()

    def on_pose(estimate):
        poses.append(estimate)
        threads.add(threading.current_thread().name)

    live = LiveOdometry(
        calibration, on_pose=on_pose, on_smoothed=smoothed.append, on_line=lines.append
    )
    with live:
        reached = [0, 0]  # each thread's, ns: neither runs away from the other

        def deliver(which, measurements):
            for m in measurements:
                reached[which] = m.stamp
                assert until(lambda: min(reached) > reached[which] - 50_000_000)
                assert until(lambda: live.waiting < 8)
                feed(live, m)
            reached[which] = 2**62

        images = frames(stream)
        samples = [m for m in stream if isinstance(m, ImuSample)]
        sensors = [
            threading.Thread(target=deliver, args=(i, list(ms)))
            for i, ms in enumerate((images, samples))
        ]
        for sensor in sensors:
            sensor.start()
        for sensor in sensors:
            sensor.join(30.0)
    assert threads == {"ruledgraph"}
    assert live.status == "closed"
    assert live.counts == (len(samples), len(images), 0, 0, len(expected))
    # The same measurements in the same order: the same numbers.
    assert [e.stamp for e in poses] == [e.stamp for e in expected]
    np.testing.assert_array_equal([e.position for e in poses], [e.position for e in expected])
    assert live.latest is poses[-1]
    assert len(smoothed) == len(odometry.take_smoothed())
    assert len(lines) == len(odometry.take_lines()) > 0


def test_what_it_waits_for():
    stream, calibration = small_stream()
    with LiveOdometry(calibration) as live:
        assert live.status == "waiting for IMU"
        live.add_imu(W, A, t=0.0)
        assert live.status == "waiting for images"
        live.add_image(frames(stream)[0].image, t=0.0)
        assert live.status == "initializing: no attempt to start yet"
    with LiveOdometry(calibration) as live:
        feed_patiently(live, stream)
        assert until(lambda: live.status in ("tracking", "still"))
        assert until(lambda: live.status == "waiting for IMU", 3.0)


def test_the_reason_why_it_does_not_start():
    calibration = small_stream()[1]
    rng = np.random.default_rng(0)
    with LiveOdometry(calibration) as live:
        # A featureless wall, in motion.
        for i in range(600):
            live.add_imu(rng.normal(size=3), rng.normal(size=3) + A, t=i * 0.005)
            if i % 6 == 0:
                live.add_image(np.full((240, 320), i % 250, np.uint8), t=i * 0.005)
            while live.waiting > 8:
                time.sleep(0.001)
        assert until(lambda: "no attempt" not in live.status)
        assert live.status.startswith("initializing: ")
        assert "line" in live.status


def test_images_are_dropped_counted_and_reported_when_it_does_not_keep_up(caplog):
    stream, calibration = small_stream()
    held, go = threading.Event(), threading.Event()

    def on_pose(_):
        held.set()
        assert go.wait(20.0)

    with LiveOdometry(calibration, on_pose=on_pose, max_images=4) as live:
        waits = []
        for measurement in stream:
            while live.waiting > 2 and not held.is_set():
                time.sleep(0.001)
            begin = time.perf_counter()
            feed(live, measurement)
            waits.append(time.perf_counter() - begin)
        assert live.waiting == 4
        assert live.counts.dropped_images > 20
        # The callback held the odometry all the while, the sensors' threads went on. A loaded
        # machine may stop a thread for a while, yet not by the 20 s of the callback.
        assert max(waits) < 5.0
        go.set()
    assert live.counts.estimates + live.counts.dropped_images <= live.counts.images
    assert "the odometry does not keep up: 1 images are dropped so far" in caplog.text


@pytest.mark.parametrize("dead", ["IMU", "images"])
def test_memory_is_bounded_when_a_sensor_is_dead(dead, caplog):
    stream, calibration = small_stream()
    image = frames(stream)[0].image
    with LiveOdometry(calibration) as live:
        for i in range(4000):
            if dead == "IMU":
                live.add_image(image, t=i * 0.03)
            else:
                live.add_imu(W, A, t=i * 0.005)
        assert live.status == f"waiting for {dead}"
        assert live.waiting == (16 if dead == "IMU" else 0)
        dropped = live.counts.dropped_images + live.counts.dropped_imu
        assert dropped == (4000 - 16 if dead == "IMU" else 4000 - 1001)
        text = "no IMU samples come" if dead == "IMU" else "no images come"
        assert text in caplog.text
        # Reported once in five seconds, not each time.
        assert len([r for r in caplog.records if r.name == "ruledgraph.live"]) <= 2


def test_a_frozen_imu_is_waited_for_and_memory_is_bounded(caplog):
    stream, calibration = small_stream()
    stop = stream[0].stamp + 3_000_000_000
    with LiveOdometry(calibration) as live:
        feed_patiently(live, [m for m in stream if m.stamp < stop])
        last = [m for m in stream if m.stamp < stop and isinstance(m, ImuSample)][-1]
        later = [m for m in stream if m.stamp >= stop]
        feed_patiently(
            live, [last._replace(stamp=m.stamp) if isinstance(m, ImuSample) else m for m in later]
        )
        assert until(lambda: live.status == "waiting for IMU")
        assert until(lambda: live.waiting == 0)  # passed on, where they do not pile up
    assert "the IMU has been frozen since" in caplog.text


def test_samples_with_nan_are_left_out_with_one_warning(caplog):
    stream, calibration = small_stream()
    with LiveOdometry(calibration) as live:
        for m in stream:
            feed_patiently(live, [m])
            if isinstance(m, ImuSample) and m.stamp % 100_000_000 == 0:
                live.add_imu((np.nan, 0.0, 0.0), A, t_ns=m.stamp + 1_000_000)
    (record,) = [r for r in caplog.records if "not finite" in r.message]
    assert record.levelname == "WARNING"
    assert live.counts.estimates > 90


def test_stamps_that_go_wrong_again_and_again_do_not_end_it():
    calibration = small_stream()[1]
    refused = 0
    with LiveOdometry(calibration) as live:
        for i in range(60):
            try:
                live.add_imu(W, A, t=5.0 * i)
            except RuledgraphError:
                refused += 1
            if i % 3 == 0:
                live.add_image(np.full((240, 320), i, np.uint8), t=5.0 * i + 1.0)
        for i in range(20):
            live.add_imu(W, A, t=295.005 + 0.005 * i)
        assert until(lambda: live.waiting == 0)
    assert refused == 57


def test_it_starts_again_after_images_were_missing(caplog):
    stream, calibration = small_stream()
    after = 8 * 10**9
    with LiveOdometry(calibration) as live:
        feed_patiently(live, stream)
        # The IMU goes on while the camera is silent, and then all comes again.
        last = stream[-1].stamp
        for stamp in range(last + 5_000_000, last + after, 5_000_000):
            live.add_imu(W, A, t_ns=stamp)
        assert live.counts.dropped_imu > 0
        count = live.counts.estimates
        for m in stream:
            stamp = m.stamp + last + after
            if isinstance(m, Frame):
                feed_patiently(live, [Frame(stamp, m.image)])
            else:
                feed_patiently(live, [m._replace(stamp=stamp)])
    assert live.counts.estimates > count + 60
    assert live.latest is not None
    assert live.latest.segment == 1
    assert "a new segment begins" in caplog.text


def test_a_reset_begins_anew():
    stream, calibration = small_stream()
    poses = []
    with LiveOdometry(calibration, on_pose=poses.append) as live:
        feed_patiently(live, stream)
        live.reset()
        # Its old stamps again.
        feed_patiently(live, stream)
    again = [i for i in range(1, len(poses)) if poses[i].stamp <= poses[i - 1].stamp]
    assert len(again) == 1
    first, second = poses[: again[0]], poses[again[0] :]
    assert live.counts.estimates == len(second)
    # What still waited at the reset is gone from the first run, so it is the shorter one.
    assert [e.stamp for e in second[: len(first)]] == [e.stamp for e in first]
    np.testing.assert_array_equal(first[0].matrix, second[0].matrix)


def test_an_error_of_a_callback_is_raised_where_measurements_are_added(caplog):
    stream, calibration = small_stream()

    def on_pose(_):
        raise LookupError("a mistake")

    live = LiveOdometry(calibration, on_pose=on_pose)
    with pytest.raises(LookupError, match="a mistake"):
        feed_patiently(live, stream)
    with pytest.raises(LookupError):
        live.close()
    assert "the odometry ended: LookupError: a mistake" in caplog.text


def test_what_is_not_allowed_from_a_callback_or_after_the_end():
    stream, calibration = small_stream()
    live = LiveOdometry(calibration, on_pose=lambda _: live.close())
    with pytest.raises(RuledgraphError, match="called from a callback"):
        feed_patiently(live, stream)
    live = LiveOdometry(calibration)
    live.close()
    live.close()
    with pytest.raises(RuledgraphError, match="is closed; make another one"):
        live.add_imu(W, A, t=0.0)


def test_wrong_order_and_units_are_refused_and_left_out():
    calibration = small_stream()[1]
    image = np.zeros((240, 320), np.uint8)
    with LiveOdometry(calibration) as live:
        live.add_imu(W, A, t=1.0)
        with pytest.raises(MeasurementError, match="in order of time"):
            live.add_imu(W, A, t=1.0)
        with pytest.raises(MeasurementError, match="check the unit of its stamp"):
            live.add_imu(W, A, t_ns=1_000_005_000)
        live.add_image(image, t=1.0)
        with pytest.raises(MeasurementError, match=r"an image at 0\.9"):
            live.add_image(image, t=0.9)
        with pytest.raises(MeasurementError, match="640x480, but the calibration is for 320x240"):
            live.add_image(np.zeros((480, 640), np.uint8), t=1.1)
        assert live.counts[:2] == (1, 1)


def test_stamps_in_milliseconds_are_refused():
    with LiveOdometry(small_stream()[1]) as live:
        for i in range(3):
            live.add_imu(W, A, t=5.0 * i)
        with pytest.raises(MeasurementError, match="IMU samples come 5 s apart"):
            live.add_imu(W, A, t=15.0)
        assert live.counts.imu == 3


@pytest.mark.parametrize("readings", [(W, (0.0, 0.0, 1.0)), (A, W)], ids=["g", "swapped"])
def test_forces_in_g_and_swapped_readings_are_refused(readings):
    with LiveOdometry(small_stream()[1]) as live:
        for i in range(200):
            live.add_imu(*readings, t_ns=5_000_000 * i)
        with pytest.raises(RuledgraphError, match=r"gyroscope .* first, then the accelerometer"):
            live.add_imu(*readings, t=1.0)


def test_warnings_go_to_the_logger(caplog):
    stream, calibration = small_stream()
    with caplog.at_level(logging.WARNING, "ruledgraph"), LiveOdometry(calibration) as live:
        feed_patiently(live, [m for m in stream if m.stamp < 2.0e9 + stream[0].stamp])
        image = frames(stream)[50].image
        for i in range(3):
            live.add_image(image, t_ns=stream[0].stamp + 2_000_000_000 + i * 33_000_000)
    assert "the camera is frozen" in caplog.text
