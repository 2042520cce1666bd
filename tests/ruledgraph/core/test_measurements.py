# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Measurements made of what programs have."""

import cv2
import numpy as np
import pytest

from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame, ImuSample, stamp_of

W, A = (0.1, 0.2, 0.3), (0.0, 0.0, 9.81)


def test_seconds_and_nanoseconds_are_the_same_stamp():
    assert stamp_of(t=12.5) == stamp_of(t_ns=12_500_000_000) == 12_500_000_000
    # float64 holds today's seconds to 0.24 microseconds.
    assert abs(stamp_of(t=1_700_000_000.123456) - 1_700_000_000_123_456_000) < 240
    assert stamp_of(t=np.float64(1e-9)) == stamp_of(t_ns=np.int64(1)) == 1


@pytest.mark.parametrize(
    ("time", "message"),
    [
        ({}, "pass the time as t=, in seconds, or as t_ns="),
        ({"t": 1.0, "t_ns": 1}, "pass the time as t=, in seconds, or as t_ns="),
        ({"t": 1.7e18}, "pass nanoseconds as t_ns="),
        ({"t": 1.7e12}, "is after the year 2262"),
        ({"t": float("nan")}, "no time in seconds"),
        ({"t": "1.0"}, "no time in seconds"),
        ({"t": True}, "no time in seconds"),
        ({"t": -1.0}, "not within 0 to 2"),
        ({"t_ns": 1.5}, "no whole number of nanoseconds; pass seconds as t="),
        ({"t_ns": 2**63}, "not within 0 to 2"),
    ],
)
def test_a_time_that_is_none_is_refused(time, message):
    with pytest.raises(RuledgraphError, match=message) as error:
        ImuSample.of(W, A, **time)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", [list, tuple, np.array, lambda v: np.array(v, dtype=np.float32)])
def test_a_sample_of_lists_and_arrays(kind):
    sample = ImuSample.of(kind(W), kind(A), t=2.0)
    assert sample.stamp == 2_000_000_000
    for values, expected in ((sample.gyroscope, W), (sample.accelerometer, A)):
        assert (values.dtype, values.shape) == (np.float64, (3,))
        np.testing.assert_allclose(values, expected, rtol=1e-7)


def test_a_sample_does_not_change_with_the_callers_buffer():
    buffer = np.array(A)
    sample = ImuSample.of(W, buffer, t=0.0)
    buffer[:] = 0.0
    np.testing.assert_array_equal(sample.accelerometer, A)


@pytest.mark.parametrize(
    ("gyroscope", "accelerometer", "message"),
    [
        ((0.0, 0.0), A, r"gyroscope: 3 numbers are wanted"),
        (W, np.zeros((3, 1)), r"accelerometer: .* not float64 of shape \(3, 1\)"),
        (("a", "b", "c"), A, "gyroscope: 3 numbers are wanted"),
        ((1j, 0, 0), A, "not complex128"),
        ((0.0, 250.0, 0.0), A, "pass rad/s, not degrees"),
        (W, (0.0, 0.0, 9810.0), "pass m/s"),
    ],
)
def test_a_reading_that_is_none_is_refused(gyroscope, accelerometer, message):
    with pytest.raises(RuledgraphError, match=message):
        ImuSample.of(gyroscope, accelerometer, t=0.0)


def test_readings_that_are_not_finite_are_left_to_the_odometry():
    sample = ImuSample.of((np.nan, 0.0, 0.0), (np.inf, 0.0, 9.81), t=0.0)
    assert np.isnan(sample.gyroscope[0])
    assert np.isinf(sample.accelerometer[0])


def test_images_are_made_grey_and_copied():
    colour = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
    alpha = np.dstack([colour, np.full((4, 6), 9, np.uint8)])
    flipped = np.ascontiguousarray(colour[:, ::-1])[:, ::-1]  # not contiguous
    for image in (grey, grey[..., None], grey.tolist(), colour, alpha, flipped):
        frame = Frame.of(image, t_ns=7)
        np.testing.assert_array_equal(frame.image, grey)
        assert frame.image.flags.c_contiguous
        assert (frame.stamp, frame.image.dtype) == (7, np.uint8)
        assert not np.shares_memory(frame.image, np.asarray(image))


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((4, 6)), "float64 pixels; convert them to 8 bit"),
        (np.zeros((4, 6), np.uint16), "uint16 pixels"),
        (np.zeros((4, 6, 2), np.uint8), r"shape \(4, 6, 2\)"),
        (np.zeros(6, np.uint8), r"shape \(6,\)"),
        (np.zeros((0, 6), np.uint8), r"shape \(0, 6\)"),
        ([[0, 300]], "no array of 8 bit pixels"),
        (None, "no array of 8 bit pixels"),
    ],
)
def test_an_image_that_is_none_is_refused(image, message):
    with pytest.raises(RuledgraphError, match=message) as error:
        Frame.of(image, t=0.0)
    assert "\n" not in str(error.value)
