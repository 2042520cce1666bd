# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

from dataclasses import replace

import gtsam
import numpy as np
import pytest

from benchmark_defects import DEFECTS, Defect, cases, cells, report
from defects import SCENES, Case, Result, Variation, figures, result_of, simulated, told, truth_of
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.simulation.simulation import D435I

REST, MOVING = SCENES
OFFSET = next(defect for defect in DEFECTS if defect.field == "offset_ms")
FOCAL = next(defect for defect in DEFECTS if defect.field == "focal_percent")


def made(live: float | None = 2.0, error: float = 0.5, **changes) -> Result:
    found = {"offset_ms": (20.0 + error, error, 0.25)}
    first = None if live is None else 0.5
    return replace(Result(0.9, 0.1, live, live, first, found), **changes)


def small(seed: int = 0, **changes) -> Case:
    return Case(MOVING, seed, replace(Variation(size="64x48"), **changes), 0.5)


def told_of(case: Case):
    true = simulated(case).calibration
    return true, told(true, case)


def test_the_good_recording_is_run_once_for_all_defects():
    chosen = cases(DEFECTS, 3, 8.0)
    values = sum(len(defect.values) - 1 for defect in DEFECTS)
    assert len(chosen) == len({case.key for case in chosen}) == 3 * len(SCENES) * (values + 1)
    assert sum(case.variation == Variation() for case in chosen) == 3 * len(SCENES)


def test_each_defect_is_in_the_recording_and_unknown_to_the_calibration():
    true, calibration = told_of(small(turned_deg=3.0, moved_mm=10.0))
    off = true.body_T_cam.between(calibration.body_T_cam)
    turn = gtsam.Rot3.Logmap(off.rotation())
    assert np.degrees(np.linalg.norm(turn)) == pytest.approx(3.0)
    assert np.linalg.norm(off.translation()) == pytest.approx(0.01)
    _, other = told_of(small(seed=1, turned_deg=3.0, moved_mm=10.0))
    assert not other.body_T_cam.equals(calibration.body_T_cam, 1e-3)
    true, calibration = told_of(small(offset_ms=-60.0, focal_percent=3.0))
    assert (true.time_offset, calibration.time_offset) == (-0.06, 0.0)
    assert calibration.camera.fx == pytest.approx(1.03 * true.camera.fx)
    assert calibration.camera.cx == true.camera.cx
    true, calibration = told_of(small(readout_ms=20.0, rate=20.0))
    assert true.readout == pytest.approx(0.02)
    assert calibration.line_delay is None


def test_the_truth_of_an_unknown_readout_is_that_of_the_middle_rows():
    good, rolling = (simulated(small(readout_ms=ms, rate=20.0)) for ms in (0.0, 20.0))
    own, truth = truth_of(good), truth_of(rolling)
    np.testing.assert_array_equal(truth.stamps, own.stamps)
    moved = good.truth(own.stamps + 10_000_000).position
    np.testing.assert_allclose(truth.positions, moved, atol=1e-12)
    assert np.abs(moved - own.positions).max() > 1e-3


def test_stamps_of_frames_and_truth_move_by_the_time_offset():
    good, late = (simulated(small(offset_ms=ms)) for ms in (0.0, -60.0))
    stamps = [[f.stamp for f in s.stream() if isinstance(f, Frame)] for s in (good, late)]
    assert len(stamps[0]) == 15
    np.testing.assert_array_equal(np.subtract(*stamps), -60_000_000)
    np.testing.assert_array_equal(truth_of(late).stamps, stamps[1])
    np.testing.assert_array_equal(truth_of(late).positions, truth_of(good).positions)
    of_all = [m.stamp for m in late.stream()]
    assert of_all == sorted(of_all)


def test_only_the_white_noise_is_stronger():
    def samples(noise: float):
        stream = simulated(small(imu_noise=noise)).stream()
        return np.array(
            [[m.gyroscope, m.accelerometer] for m in stream if isinstance(m, ImuSample)]
        )

    one, four, seven = (samples(noise) for noise in (1.0, 4.0, 7.0))
    np.testing.assert_allclose(seven - four, four - one, atol=1e-12)
    density = (four - one)[:, 0].std() / 3.0 / np.sqrt(200.0)
    assert density == pytest.approx(D435I.imu_noise.gyroscope, rel=0.1)


def test_cells_are_median_and_range_and_the_worst_of_the_seeds():
    results = [made(2.0), made(1.0, frames=0.8), made(4.0, error=1.0, degraded=0.3)]
    spread = "2.0 (1.0 to 4.0)"
    expected = ["80", "30", spread, spread, "0.50", "20.50", "1.00", "**4.0**"]
    assert cells(OFFSET, results) == expected
    assert cells(FOCAL, results)[5:] == ["", "", ""]


def test_a_seed_without_a_pose_is_the_worst():
    assert cells(FOCAL, [made(2.0), made(None)])[2:5] == ["none (2.0 to none)"] * 2 + ["none"]
    assert cells(FOCAL, [made(None)])[2] == "none"


def test_figures_of_a_summary_with_the_truth():
    true = replace(D435I, time_offset=0.02)
    turned = D435I.body_T_cam.compose(gtsam.Pose3(gtsam.Rot3.Rx(np.radians(0.1)), np.zeros(3)))
    summary = {
        "frames": 10,
        "frames_estimated": 8,
        "first_frame_ns": 10**9,
        "status": {"tracking": 6, "degraded": 2, "without estimate": 2},
        "accuracy": {"trajectory_live": {"ate_rmse": 2e-3}, "trajectory": {"error": "too few"}},
        "warnings": ["one"],
        "time_offset": {"s": 0.019, "sigma_s": 5e-4, "estimated": True},
        "extrinsics": {
            "estimated": True,
            "rotation_deg": 2.1,
            "sigma_rotation_deg": 0.05,
            "T_cam_imu": turned.inverse().matrix().tolist(),
        },
        "focal_length": {"estimated": True, "ratio": 1.0 / 1.029, "sigma_ratio": 0.002},
    }
    result = figures(summary, 1_500_000_000, true, focal_percent=3.0)
    assert (result.frames, result.degraded, result.live, result.smoothed) == (0.8, 0.25, 2.0, None)
    assert result.first_pose == pytest.approx(0.5)
    assert result.recovered["offset_ms"] == pytest.approx((19.0, 1.0, 0.5))
    assert result.recovered["turned_deg"] == pytest.approx((2.1, 0.1, 0.05))
    assert result.recovered["focal_percent"] == pytest.approx((2.9, 0.1, 0.2))
    held = {"estimated": False}
    summary |= {"extrinsics": held, "focal_length": held, "frames_estimated": 0, "status": {}}
    result = figures(summary, None, true)
    assert (result.degraded, result.first_pose) == (0.0, None)
    assert set(result.recovered) == {"offset_ms"}
    summary |= {"readout_s": 0.021, "readout_sigma_s": 0.004, "frames_estimated": 8}
    rolling = true.with_readout(0.02)
    recovered = figures(summary, None, rolling).recovered
    assert recovered["readout_ms"] == pytest.approx((21.0, 1.0, 4.0))
    assert recovered["offset_ms"] == pytest.approx((19.0, 11.0, 0.5))


def test_the_report_counts_how_often_the_truth_is_within_three_sigma():
    defect = Defect("offset_ms", "time offset, ms", (0, 20))
    chosen = cases([defect], 2, 8.0)
    results = {case.key: made(error=0.5 if case.seed else 1.0) for case in chosen}
    lines = report([defect], 2, 8.0, results).splitlines()
    assert len(lines) == 2 + 4 + 1 + 2
    assert lines[2].startswith(f"| {REST} | time offset, ms | 0 | 90 | 10 | 2.0 (2.0 to 2.0) |")
    assert lines[-2] == "time offset, ms, its own rows: 4 of 8 runs within 3 sigma"


def test_all_rows_count_each_run_with_a_pose_once():
    rate = Defect("rate", "frame rate, Hz", (5, 30))
    chosen = cases([OFFSET, rate], 1, 8.0)
    results = {case.key: made(frames=0.9 if case.variation.rate == 30 else 0.0) for case in chosen}
    lines = report([OFFSET, rate], 1, 8.0, results).splitlines()
    assert lines[-2] == "time offset, ms, its own rows: 10 of 10 runs within 3 sigma"
    assert lines[-1] == "time offset, ms, all rows: 10 of 10 runs within 3 sigma"


def test_a_recording_with_a_time_offset_and_a_turned_camera():
    variation = Variation(offset_ms=20.0, turned_deg=2.0, size="320x240")
    result = result_of(Case(MOVING, 0, variation, 3.0))
    assert result.frames > 0.3
    assert result.live is not None
    assert result.live < 50.0
    assert result.first_pose is not None
    value, error, sigma = result.recovered["offset_ms"]
    assert abs(value - 20.0) == pytest.approx(error)
    assert 0.0 < sigma < 10.0
    assert result.recovered["turned_deg"][1] < 2.0
