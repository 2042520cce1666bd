# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

from dataclasses import replace

import numpy as np
import pytest

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.measurements import Frame, ImuSample
from small_runs import ate, run
from small_simulation import SMALL, frames, small_simulation, small_stream
from variants import VARIANTS, turned_camera

BENT = CameraModel(320, 240, 231.0, 229.0, 158.0, 121.0, "radtan", (-0.2, 0.05, 2e-3, -1e-3))


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_turned_camera_sees_a_point_where_the_turned_image_has_it(quarters):
    calibration = replace(SMALL, camera=BENT)
    turned = turned_camera(calibration, quarters)
    point = np.array([0.3, -0.2, 1.5])  # in the camera
    pixel = BENT.distort(point[None, :2] / point[2]).pixels[0]
    in_turned = turned.body_T_cam.transformTo(calibration.body_T_cam.transformFrom(point))
    found = turned.camera.distort(in_turned[None, :2] / in_turned[2]).pixels[0]
    image = np.zeros((240, 320), np.uint8)
    column, row = np.round(pixel).astype(int)
    image[row, column] = 255
    rows, columns = np.nonzero(np.rot90(image, quarters))
    assert np.abs(found - [columns[0], rows[0]]).max() < 0.51
    assert (turned.camera.height, turned.camera.width) == np.rot90(image, quarters).shape


@pytest.mark.parametrize("name", VARIANTS)
def test_images_have_the_size_of_the_calibration(name):
    variant, (stream, calibration) = VARIANTS[name], small_stream()
    camera = variant.calibration(calibration).camera
    some = [m for m in stream if m.stamp < stream[0].stamp + 2 * 10**8]
    changed = list(variant.changed(some, np.random.default_rng(0)))
    images = [m.image for m in changed if isinstance(m, Frame)]
    assert len(images) == len(frames(some))
    assert {image.shape for image in images} == {(camera.height, camera.width)}
    assert sum(isinstance(m, ImuSample) for m in changed) > 5


@pytest.mark.parametrize("name", ["turned by 90 deg", "IMU turned on the body"])
def test_a_turned_sensor_sees_the_same_motion(name):
    variant, (stream, calibration) = VARIANTS[name], small_stream()
    changed = variant.changed(stream, np.random.default_rng(0))
    _, live, _ = run(changed, variant.calibration(calibration))
    assert len(live) > 90
    assert ate(live, small_simulation()) < 0.02  # as that of the stream as it is
