# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from benchmark_recordings import Case, report, unpacked
from recorded_runs import Recorded, Run, changed, changed_camera
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.measurements import Frame
from ruledgraph.evaluation.ground_truth import read_ground_truth
from ruledgraph.simulation import RecordedImu

RECORDED = Recorded("a.bag", "a.yaml", "a.tum")
CAMERA = CameraModel(200, 100, 150.0, 151.0, 99.5, 49.5, "radtan", (-0.2, 0.05, 1e-3, 1e-3))


def made(ate: float | None) -> Run:
    return Run(0.0, 1.0, 1.0, 0.9, 0.0, ate, ate, 1.0, (), ate, ate)


def test_whole_recordings_and_starts_are_told_apart():
    rows = [
        (Case("one", RECORDED), made(4.0)),
        (Case("from 2 s", RECORDED, 2.0, 8.0), made(9.0)),
        (Case("from 3 s", RECORDED, 3.0, 8.0), made(None)),
    ]
    text = report(rows)
    assert "| one | 90 | 0 | 1.00 | 4.0 | 4.0 | 4.0 | 1.000 | 4.0 |" in text
    assert "from 2 s" not in text
    assert "1 whole: live ATE median 4.0 mm" in text
    # A run without a pose counts as 100 mm: sqrt(9 * 100) = 30.
    assert "2 starts: live ATE median 54.5 mm, geometric mean 30.0, 1 over 25 mm" in text


@pytest.mark.parametrize(
    "recorded",
    [
        Recorded("", "", "", shrink=2),
        Recorded("", "", "", crop=(20, 10, 120, 80)),
        Recorded("", "", "", shrink=4, crop=(20, 10, 121, 82)),
    ],
)
def test_pixel_and_model_move_together(recorded):
    """A bright square's middle, where the model of the changed image has it."""
    point = np.array([[0.05, -0.03]])
    u, v = CAMERA.distort(point).pixels[0].round().astype(int)
    image = np.zeros((100, 200), np.uint8)
    image[v - 6 : v + 7, u - 6 : u + 7] = 200
    ray = CAMERA.undistort(np.array([[float(u), float(v)]]))
    small = changed(Frame(0, image), recorded).image
    camera = changed_camera(CAMERA, recorded)
    assert small.shape == (camera.height, camera.width)
    weights = small.astype(float) / small.sum()
    rows, columns = np.indices(small.shape)
    middle = [(weights * columns).sum(), (weights * rows).sum()]
    # Pixels of the small image have 8 bit.
    np.testing.assert_allclose(camera.distort(ray).pixels[0], middle, atol=0.02)


def test_a_packed_flight_becomes_eurocs_files(tmp_path):
    """To the last digit."""
    rng = np.random.default_rng(1)
    stamps = 1403715273262142976 + 5_000_000 * np.arange(20)
    states, imu = rng.normal(size=(20, 10)), rng.normal(size=(20, 6))
    states[:, 3:7] /= np.linalg.norm(states[:, 3:7], axis=1, keepdims=True)
    np.savez(tmp_path / "flight.npz", gt_ns=stamps, gt=states, imu_ns=stamps, imu=imu)
    folder = unpacked(tmp_path / "flight.npz", tmp_path / "flight")
    truth = read_ground_truth(folder / "groundtruth.csv")
    np.testing.assert_array_equal(truth.stamps, stamps)
    np.testing.assert_array_equal(truth.positions, states[:, :3])
    w, xyz = truth.quaternions[:, 3], truth.quaternions[:, :3]
    # Of one sign all along, which is theirs or the other.
    sign = np.sign(w * states[:, 3])[:, None]
    np.testing.assert_allclose(sign * xyz, states[:, 4:7], atol=1e-12)
    np.testing.assert_array_equal(RecordedImu(folder / "imu0.csv").stamps, stamps)
    samples = np.loadtxt(folder / "imu0.csv", delimiter=",", comments="#")
    np.testing.assert_array_equal(samples[:, 1:], imu)
