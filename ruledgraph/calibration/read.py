# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Finds the camera and the IMU in calibration files."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

import gtsam

from ruledgraph.calibration.camera_fields import model_of_camera, model_of_info
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import ADIS16448_LIKE, D435I_LIKE, MIN_NOISE, ImuNoise
from ruledgraph.calibration.rig import Calibration
from ruledgraph.calibration.sensor_fields import NOISE_KEYS, CalibrationError, Section
from ruledgraph.core.plain_yaml import YamlError, read_yaml

TYPICAL_IMU_NOISE = {"d435i": D435I_LIKE, "adis16448": ADIS16448_LIKE}
"""Noise figures by sensor, for calibrations that leave them out."""

_POSE_KEYS = ("T_cam_imu", "T_imu_cam", "T_BS")
_LARGEST_TIME_OFFSET = 10.0  # s
_LARGEST_NOISE = 10.0
# s; sensors read a row in 5 to 100 us: more is in another unit, or of the whole image.
_LARGEST_LINE_DELAY = 1e-3

Kind: TypeAlias = Literal["camera", "imu", "info"]


def read_calibration(
    *paths: str | Path,
    camera: str | None = None,
    image_topic: str | None = None,
    camera_model: CameraModel | None = None,
    imu_noise: ImuNoise | None = None,
) -> Calibration:
    """Read one camera and the IMU from one or more files, whose formats their content tells.

    Kalibr camchain and IMU files, apart or in one; EuRoC `sensor.yaml` files or the folder that
    holds them; ROS CameraInfo, whose camera model replaces that of the other files.

    Args:
        paths: files, or EuRoC (ASL) folders.
        camera: name of the camera where there are several, such as `cam0`.
        image_topic: chooses the camera that was calibrated on this topic.
        camera_model: used instead of the files' (see `camera_from_info`).
        imu_noise: used instead of the files' (see `TYPICAL_IMU_NOISE`).

    Raises:
        CalibrationError: for anything missing, wrong or implausible.
    """
    sources = _collect([Path(path) for path in paths])
    name = _chosen(sources, camera, image_topic)
    section = sources.cameras[name]
    if camera_model is None:
        camera_model = model_of_info(sources.info) if sources.info else model_of_camera(section)
    return Calibration(
        camera=camera_model,
        body_T_cam=_body_T_cam(sources, name),
        imu_noise=imu_noise or _imu_noise(sources),
        time_offset=section.number(
            "timeshift_cam_imu", -_LARGEST_TIME_OFFSET, _LARGEST_TIME_OFFSET, default=0.0
        ),
        time_offset_exact=section.flag("timeshift_exact"),
        line_delay=_line_delay(section),
        image_topic=section.text("rostopic") or None,
        imu_topic=(sources.imu.text("rostopic") or None) if sources.imu else None,
    )


def _line_delay(section: Section) -> float | None:
    if "line_delay" not in section.values:
        return None
    return section.number("line_delay", 0.0, _LARGEST_LINE_DELAY)


@dataclass
class _Sources:
    """What the files hold, still unread."""

    files: str
    """Their names, for errors."""
    cameras: dict[str, Section] = field(default_factory=dict)
    imu: Section | None = None
    info: Section | None = None


def _collect(paths: list[Path]) -> _Sources:
    files = [file for path in paths for file in _files(path)]
    sources = _Sources(files=", ".join(map(str, files)))
    for path in files:
        for kind, name, section in _sections(path):
            if kind == "imu":
                doubled, sources.imu = sources.imu, section
            elif kind == "info":
                doubled, sources.info = sources.info, section
            else:
                doubled = sources.cameras.get(name)
                sources.cameras[name] = section
            if doubled:
                raise CalibrationError(f"{path}: {name} is in {doubled.file} too, leave one out")
    return sources


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    root = path / "mav0" if (path / "mav0").is_dir() else path
    cameras = sorted(root.glob("cam*/sensor.yaml"))
    if not cameras:
        raise CalibrationError(f"{path}: no cam0/sensor.yaml in this folder, give a file")
    return cameras + sorted(root.glob("imu0/sensor.yaml"))


def _sections(path: Path) -> list[tuple[Kind, str, Section]]:
    """The sensors in a file, by kind and name."""
    try:
        node = read_yaml(path)
    except YamlError as error:
        raise CalibrationError(str(error)) from None
    values = node if isinstance(node, dict) else {}
    sections: list[tuple[Kind, str, Section]] = []
    # Kalibr gives the cameras' poses relative to imu0; other IMUs have no part in it.
    for name in (key for key in values if re.fullmatch(r"cam[0-9]{1,3}|imu0", key)):
        value = values[name]
        if not isinstance(value, dict):
            raise CalibrationError(f"{path}: {name} must be a mapping")
        kind: Kind = "imu" if name == "imu0" else "camera"
        sections.append((kind, name, Section(str(path), f"{name}/", value)))
    if sections:
        return sections
    whole = Section(str(path), "", values)
    name = path.parent.name if path.name == "sensor.yaml" else path.stem
    if any(key in values for key in NOISE_KEYS.values()):
        return [("imu", "imu0", whole)]
    if any(key in values for key in ("camera_matrix", "K", "k")):
        return [("info", "CameraInfo", whole)]
    if any(key in values for key in ("intrinsics", *_POSE_KEYS)):
        return [("camera", name, whole)]
    raise CalibrationError(
        f"{path}: holds no calibration; give a Kalibr camchain or imu file, "
        "an EuRoC sensor.yaml or a ROS CameraInfo"
    )


def _chosen(sources: _Sources, camera: str | None, image_topic: str | None) -> str:
    """Name of the camera to use."""
    cameras = sources.cameras
    if not cameras:
        raise CalibrationError(
            f"{sources.files or 'no file given'}: T_cam_imu is missing, the transform from IMU "
            "to camera coordinates; add a file with cam0/T_cam_imu, such as Kalibr's "
            "camchain-imucam.yaml"
        )
    flags = ", ".join(
        f"--camera {name}"
        + (f" ({section.text('rostopic')})" if "rostopic" in section.values else "")
        for name, section in cameras.items()
    )
    if camera is not None:
        if camera not in cameras:
            raise CalibrationError(f"{sources.files}: no camera {camera}, but {flags}")
        return camera
    matching = [name for name in cameras if _is_on(name, cameras[name], image_topic or "")]
    if len(cameras) > 1 and len(matching) != 1:
        raise CalibrationError(f"{sources.files}: {len(cameras)} cameras, choose one: {flags}")
    return (matching or list(cameras))[0]


def _is_on(name: str, section: Section, image_topic: str) -> bool:
    """Whether the camera was calibrated on this topic; without a record of it, by its name."""
    words = image_topic.removesuffix("/compressed").strip("/").split("/")
    if "rostopic" in section.values:
        calibrated = section.text("rostopic").removesuffix("/compressed")
        return words == calibrated.strip("/").split("/")
    return name in words


def _imu_noise(sources: _Sources) -> ImuNoise:
    flags = ", ".join(f"--imu {name}" for name in TYPICAL_IMU_NOISE)
    if sources.imu is None:
        raise CalibrationError(
            f"{sources.files}: no IMU noise densities; add Kalibr's imu.yaml or "
            f"EuRoC's imu0/sensor.yaml, or take typical figures: {flags}"
        )
    figures = {}
    for name, key in NOISE_KEYS.items():
        if key not in sources.imu.values:
            raise sources.imu.error(key, f"is missing; add it, or take typical figures: {flags}")
        if sources.imu.some_numbers(key, 1)[0] == 0.0:
            raise sources.imu.error(key, "= 0 is no noise figure, give a positive one")
        figures[name] = sources.imu.number(key, MIN_NOISE, _LARGEST_NOISE)
    return ImuNoise(**figures)


def _body_T_cam(sources: _Sources, name: str) -> gtsam.Pose3:
    """The camera's pose on the IMU, through the chain of cameras where it has none itself."""
    chosen = sources.cameras[name]
    section, section_T_cam = chosen, gtsam.Pose3()
    while "T_cn_cnm1" in section.values and not section.values.keys() & _POSE_KEYS:
        section_T_cam = section.transform("T_cn_cnm1").inverse() * section_T_cam
        name = f"cam{int(name[3:]) - 1}" if re.fullmatch(r"cam[0-9]{1,3}", name) else ""
        if name not in sources.cameras:
            break
        section = sources.cameras[name]
    if "T_cam_imu" in section.values:
        return section.transform("T_cam_imu").inverse() * section_T_cam
    if "T_imu_cam" in section.values:
        return section.transform("T_imu_cam") * section_T_cam
    if "T_BS" in section.values:
        # EuRoC's body need not be the IMU; ours is.
        imu = sources.imu
        rig_T_imu = imu.transform("T_BS") if imu and "T_BS" in imu.values else gtsam.Pose3()
        return rig_T_imu.inverse() * section.transform("T_BS") * section_T_cam
    raise chosen.error("T_cam_imu", "is missing, the transform from IMU to camera coordinates")
