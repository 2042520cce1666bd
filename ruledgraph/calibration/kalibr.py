# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Writes calibrations in Kalibr's format."""

from collections.abc import Iterable
from pathlib import Path

from ruledgraph.calibration.camera_fields import kalibr_words
from ruledgraph.calibration.rig import Calibration
from ruledgraph.calibration.sensor_fields import NOISE_KEYS, CalibrationError


def write_kalibr(calibration: Calibration, path: str | Path) -> None:
    """Write one file in Kalibr's format, with `cam0` and `imu0`.

    `read_calibration` reads the same numbers back, the pose to rounding.

    Raises:
        CalibrationError: when the file exists or cannot be written.
    """
    camera, noise = calibration.camera, calibration.imu_noise
    line_delay = calibration.line_delay
    words = kalibr_words(camera)
    rows = [_list(row) for row in calibration.body_T_cam.inverse().matrix()]
    lines = ["cam0:", "  T_cam_imu:", *(f"  - {row}" for row in rows)]
    lines += [
        f"  camera_model: {words.camera_model}",
        f"  distortion_coeffs: {_list(words.distortion)}",
        f"  distortion_model: {words.distortion_model}",
        f"  intrinsics: {_list(words.intrinsics)}",
        f"  resolution: [{camera.width}, {camera.height}]",
        *([f"  rostopic: {calibration.image_topic}"] if calibration.image_topic else []),
        f"  timeshift_cam_imu: {_number(calibration.time_offset)}",
        *(["  timeshift_exact: true"] if calibration.time_offset_exact else []),
        *([] if line_delay is None else [f"  line_delay: {_number(line_delay)}"]),
        "imu0:",
        *(f"  {key}: {_number(getattr(noise, name))}" for name, key in NOISE_KEYS.items()),
        *([f"  rostopic: {calibration.imu_topic}"] if calibration.imu_topic else []),
    ]
    try:
        with Path(path).open("x", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")
    except FileExistsError:
        raise CalibrationError(f"{path}: exists already, choose another name") from None
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be written: {error.strerror}") from None


def _number(value: float) -> str:
    """Shortest exact text; YAML 1.1, which Kalibr reads, wants a point before an exponent."""
    text = repr(float(value))
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def _list(values: Iterable[float]) -> str:
    return f"[{', '.join(map(_number, values))}]"
