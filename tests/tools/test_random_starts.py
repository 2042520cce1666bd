# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import textwrap

import pytest

from benchmark_recordings import Case
from random_starts import drawn, report
from recorded_runs import Recorded, Run

CALIBRATION = """
    cam0:
      camera_model: pinhole
      intrinsics: [200.0, 200.0, 100.0, 50.0]
      resolution: [200, 100]
      distortion_model: radtan
      distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
      T_cam_imu: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    imu0:
      gyroscope_noise_density: 1.0e-3
      accelerometer_noise_density: 1.0e-2
      gyroscope_random_walk: 1.0e-5
      accelerometer_random_walk: 1.0e-4
"""


@pytest.fixture
def source(tmp_path):
    calibration = tmp_path / "calibration.yaml"
    calibration.write_text(textwrap.dedent(CALIBRATION))
    return Case("room", Recorded("room.bag", str(calibration), "room.tum"))


def test_parts_are_drawn_alike_and_lie_within_image_and_recording(source):
    runs = drawn([source], [30.0], 200, seed=3)
    assert runs == drawn([source], [30.0], 200, seed=3)
    assert runs != drawn([source], [30.0], 200, seed=4)
    assert all(0.0 <= run.begin <= 22.0 for run in runs)
    crops = [run.recorded.crop for run in runs if run.recorded.crop]
    for left, top, width, height in crops:
        assert width >= 100
        assert height >= 50
        assert 0 <= left <= 200 - width
        assert 0 <= top <= 100 - height
    # Half of them, to four standard deviations of a binomial: 100 +- 28.
    assert 72 <= len(crops) <= 128
    assert {(run.recorded.shrink, run.recorded.every) for run in runs} == {
        (1, 1),
        (1, 2),
        (2, 1),
        (2, 2),
    }


def test_a_runaway_is_named():
    fine = Run(2.0, 1.0, 1.0, 0.9, 0.0, 5.0, 9.0, 1.0, (), 4.0, 5.0, 9.0, 0.01, 0.0)
    far = Run(3.0, 1.0, 1.0, 0.9, 0.0, 80.0, 150.0, 1.0, (), 4.0, 5.0, 120.0, 0.07, 0.02)
    none = Run(4.0, None, None, 0.0, 0.0, None, None, None, ())
    plain = Run(2.0, 1.0, 1.0, 0.9, 0.0, 5.0, 9.0, 1.0, ())
    text = report([("a", fine), ("b", far), ("c", none)])
    assert "3 runs, 2 with a trajectory: live ATE median 42.5 mm" in text
    assert "1 runaways; 1 of 2 unreported; frames beyond three sigmas 4.0 %" in text
    assert "0 of 0 unreported; frames beyond three sigmas - %" in report([("a", plain)])
    assert "- b, from 3 s: 120 mm off while reliable" in text
    assert "- a" not in text


def test_recordings_have_rows_of_their_own():
    known = {"nis": 0.5, "nees": 0.8}
    runs = [
        ("hall, whole images", Run(2.0, 1.0, 1.0, 0.9, 0.0, 5.0, 9.0, 1.0, (), **known)),
        ("room, half", Run(2.0, 1.0, 1.0, 0.8, 0.0, 7.0, 9.0, 1.0, (), nis=0.9, nees=1.2)),
        ("room, whole", Run(4.0, None, None, 0.0, 0.0, None, None, None, ())),
    ]
    *_, hall, room = report(runs).splitlines()
    assert hall == "| hall | 1 | 0 | 90 | 5.0 | 5.0 | 5 | 0.50 | 0.80 |"
    assert room == "| room | 2 | 1 | 40 | 7.0 | 7.0 | 7 | 0.90 | 1.20 |"
