# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a run has found of the calibration: for the summary, and as a file to use from then on."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from ruledgraph.calibration import write_kalibr
from ruledgraph.calibration.online_calibration import turned_by
from ruledgraph.odometry import Odometry


def calibration_summary(odometry: Odometry) -> dict[str, Any]:
    """Time offset, extrinsics, focal length and readout: what was given and found."""
    readout, found_readout = odometry.calibration.readout, odometry.calibration_search.readout.found
    rolling: dict[str, Any] = {"readout_s": readout} if readout else {}
    if found_readout is not None:
        rolling = {"readout_s": found_readout.value, "readout_sigma_s": found_readout.sigma}
    found = {
        "time_offset": _time_offset(odometry),
        "extrinsics": _extrinsics(odometry),
        "focal_length": _focal_length(odometry),
    }
    return found | rolling


def write_found_calibration(odometry: Odometry, path: Path) -> None:
    """Write the calibration with time offset, extrinsics, focal length and readout as known by now;
    the rest, such as the IMU's noise figures, as given.

    Raises:
        CalibrationError: when it cannot be written.
    """
    known, ratio = odometry.online_calibration.current, odometry.online_calibration.focal_ratio
    offset = odometry.time_offset.value
    if known.stamp_at_middle_row:
        offset -= 0.5 * known.readout  # the file's is of the first row
    found = dataclasses.replace(
        odometry.calibration,
        camera=known.camera if ratio is None else known.camera.with_focal_ratio(ratio.value),
        body_T_cam=known.body_T_cam,
        line_delay=known.line_delay,
        time_offset=offset,
    )
    write_kalibr(found, path)


def _time_offset(odometry: Odometry) -> dict[str, Any]:
    """In s."""
    value, sigma = odometry.time_offset
    found = odometry.calibration_search.found
    return {
        "s": value,
        "sigma_s": sigma,
        "estimated": odometry.config.time_offset.estimate,
        "given_s": odometry.calibration.time_offset,
        "images_s": None if found is None else found.value,
        "images_sigma_s": None if found is None else found.sigma,
        "images_used": odometry.calibration_search.used,
    }


def _extrinsics(odometry: Odometry) -> dict[str, Any]:
    """How far the camera is from where the calibration has it, and the pose found."""
    online_calibration, given = odometry.online_calibration, odometry.calibration.body_T_cam
    known = online_calibration.extrinsics
    if known is None:
        return {"estimated": False}
    angle, sigma = turned_by(given, known)
    moved = given.between(known.body_T_cam).translation()
    variances = np.linalg.eigvalsh(known.covariance[3:, 3:])
    return {
        "estimated": True,
        "rotation_deg": float(np.degrees(angle)),
        "sigma_rotation_deg": float(np.degrees(sigma)),
        "translation_m": float(np.linalg.norm(moved)),
        "sigma_translation_m": float(np.sqrt(variances[-1])),
        "T_cam_imu": known.body_T_cam.inverse().matrix().tolist(),
    }


def _focal_length(odometry: Odometry) -> dict[str, Any]:
    """Over the calibration's."""
    known = odometry.online_calibration.focal_ratio
    if known is None:
        return {"estimated": False}
    return {"estimated": True, "ratio": known.value, "sigma_ratio": known.sigma}
