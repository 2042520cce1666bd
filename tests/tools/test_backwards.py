# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from backwards import backward_calibration, backward_truth, played_backwards
from ruledgraph.core.measurements import Frame, Gap, ImuSample
from ruledgraph.evaluation.ground_truth import GroundTruth
from small_runs import ate, run
from small_simulation import frames, small_simulation, small_stream


def values(item):
    return (item.stamp, item.image) if isinstance(item, Frame) else item


def test_twice_it_is_as_it_was():
    stream, calibration = small_stream()
    some = [*stream[:60], Gap(stream[59].stamp, stream[60].stamp), *stream[60:120]]
    again, total = played_backwards(played_backwards(some)[0])
    assert total == some[0].stamp + some[-1].stamp
    for one, other in zip(some, again, strict=True):
        assert type(one) is type(other)
        for own, found in zip(values(one), values(other), strict=True):
            np.testing.assert_array_equal(own, found)
    offset = replace(calibration, time_offset=0.03)
    assert backward_calibration(offset).time_offset == -0.03
    turned = backward_calibration(backward_calibration(offset))
    np.testing.assert_allclose(turned.body_T_cam.matrix(), offset.body_T_cam.matrix(), atol=1e-12)
    assert replace(turned, body_T_cam=offset.body_T_cam) == offset


def test_stamps_rise_and_a_gap_comes_before_the_sample_that_ends_it():
    samples = [ImuSample(t, np.full(3, t), np.zeros(3)) for t in (0, 5, 100)]
    turned, total = played_backwards([*samples[:2], Gap(5, 100), samples[2]])
    assert total == 100
    assert [item.stamp for item in turned if isinstance(item, ImuSample)] == [0, 95, 100]
    assert turned[1] == Gap(0, 95)
    np.testing.assert_array_equal(turned[0].gyroscope, [-100.0] * 3)


def test_the_odometry_follows_a_simulated_motion_backwards():
    stream, calibration = small_stream()
    turned, total = played_backwards(stream)
    _, live, _ = run(turned, backward_calibration(calibration))
    stamps = np.array([frame.stamp for frame in frames(turned)])
    true = small_simulation().truth(total - stamps[::-1])
    truth = backward_truth(GroundTruth(total - stamps[::-1], true.position, None), total)
    np.testing.assert_array_equal(truth.stamps, stamps)

    def at(stamps):
        index = np.searchsorted(truth.stamps, stamps)
        return SimpleNamespace(position=truth.positions[index])

    assert len(live) > 0.7 * len(stamps)
    # 1.2 mm, as the same motion forwards.
    assert ate(live, SimpleNamespace(truth=at)) < 5e-3
