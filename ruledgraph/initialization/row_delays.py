# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Rays of a rolling shutter's images, turned to the time of the middle row by the gyroscope."""

import numpy as np

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.initialization.image_rotation import PointPairs
from ruledgraph_factors import ImuSamples
from ruledgraph_factors.so3 import exp_and_right_jacobian


def gyroscope_angles(samples: ImuSamples) -> FloatArray:
    """Integral of the gyroscope from the first sample on, by the trapezoidal rule, (N, 3), rad."""
    times, rates = np.asarray(samples.times), samples.gyroscope
    angles = np.zeros_like(rates)
    angles[1:] = np.cumsum(0.5 * (rates[1:] + rates[:-1]) * np.diff(times)[:, None], axis=0)
    return angles


def at_middle_row(
    pairs: PointPairs, samples: ImuSamples, calibration: Calibration, offset: float
) -> PointPairs:
    """Pairs with the rays as they would have been seen by a global shutter at the middle row's
    time, but for the translation.

    Args:
        pairs: whose times are of the middle rows, of the camera's clock.
        samples: of the gyroscope.
        calibration: of the camera, with its line_delay.
        offset: t_imu - t_cam, s.
    """
    angles = gyroscope_angles(samples)
    times, middles = np.asarray(samples.times), pairs.times + offset
    cam_R_body = calibration.body_T_cam.rotation().matrix().T
    turned = [
        _turned(rays, middle, angles @ cam_R_body.T, times, calibration)
        for rays, middle in zip((pairs.before, pairs.after), middles.T, strict=True)
    ]
    return PointPairs(pairs.times, *turned)


def _turned(
    rays: FloatArray,
    middle: FloatArray,
    angles: FloatArray,
    times: FloatArray,
    calibration: Calibration,
) -> FloatArray:
    """Rays (P, n, 3) of images whose middle rows are exposed at `middle` (P,), s."""
    there = rays[..., 2] > 0.0
    seen = rays[there]
    rows = calibration.camera.distort(seen[:, :2] / seen[:, 2:]).pixels[:, 1]
    own = np.broadcast_to(middle[:, None], there.shape)[there]
    exposed = own + rows * (calibration.line_delay or 0.0) - 0.5 * calibration.readout
    turn = [np.interp(exposed, times, a) - np.interp(own, times, a) for a in angles.T]
    R, _ = exp_and_right_jacobian(np.stack(turn, axis=1))
    found = rays.copy()
    found[there] = np.einsum("nij,nj->ni", R, seen)
    return found
