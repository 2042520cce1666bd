# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Camera models from their description in Kalibr's, EuRoC's and ROS's words."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ruledgraph.calibration.camera_model import CameraModel, DistortionModel
from ruledgraph.calibration.sensor_fields import Section
from ruledgraph.calibration.wide_angle import WIDE_ANGLE, magnification, parameter_fault
from ruledgraph.core.errors import RuledgraphError

_DISTORTION: dict[str, DistortionModel] = {
    "radtan": "radtan",  # Kalibr
    "radial-tangential": "radtan",  # EuRoC
    "plumb_bob": "radtan",  # ROS
    "rational_polynomial": "radtan",  # ROS; with its denominator zero the same model
    "equidistant": "equidistant",
    "fisheye": "equidistant",
    "none": "none",
    "": "none",
}
# Camera models of Kalibr and how many parameters come before the four of a pinhole.
_OWN_PARAMETERS: dict[Any, int] = {"pinhole": 0, "omni": 1, "eucm": 2, "ds": 2}
_LARGEST_IMAGE = 20_000  # px
# Places looked at along each side of the image, and the least share of them with a viewing ray:
# towards the corners the polynomial of a good calibration may fold over.
_PLACES, _PLACES_SEEN = 5, 0.5
_FOCAL_LENGTH = (0.1, 20.0)  # of the image's longer side


def model_of_camera(section: Section) -> CameraModel:
    """Model of a Kalibr or EuRoC camera."""
    projection: Any = section.text("camera_model", "pinhole")
    if projection not in _OWN_PARAMETERS:
        raise section.error(
            "camera_model",
            f"{projection[:40]!r} is not supported; calibrate with one of "
            f"{', '.join(_OWN_PARAMETERS)}",
        )
    count = _OWN_PARAMETERS[projection]
    *own, fx, fy, cx, cy = section.some_numbers("intrinsics", count + 4)
    width, height = section.some_numbers("resolution", 2)
    coefficients = section.key("distortion_coeffs", "distortion_coefficients")
    keys = ("resolution", "intrinsics", coefficients)
    if projection == "pinhole":
        return _checked(section, keys, (width, height), (fx, fy, cx, cy))
    if fault := parameter_fault(projection, tuple(own)):
        raise section.error("intrinsics", f"do not fit: {fault}")
    # What the lens does near its axis is a pinhole's part of it.
    zoom = magnification(projection, tuple(own))
    near = _checked(section, keys, (width, height), (fx * zoom, fy * zoom, cx, cy))
    if near.distortion not in (("none", "radtan") if projection == "omni" else ("none",)):
        raise section.error(
            "distortion_model", f"{near.distortion!r} does not go with camera_model {projection}"
        )
    parameters = (*own, *near.coefficients)
    if projection == "omni" and len(near.coefficients) > 4:
        raise section.error(coefficients, "are 5, but camera_model omni takes 4")
    return replace(near, fx=fx, fy=fy, distortion=projection, coefficients=parameters)


class KalibrWords(NamedTuple):
    """A camera model as Kalibr writes it."""

    camera_model: str
    intrinsics: tuple[float, ...]
    distortion_model: str
    distortion: tuple[float, ...]


def kalibr_words(camera: CameraModel) -> KalibrWords:
    """What `model_of_camera` reads the same model from."""
    pinhole = (camera.fx, camera.fy, camera.cx, camera.cy)
    if camera.distortion not in WIDE_ANGLE:
        return KalibrWords("pinhole", pinhole, camera.distortion, camera.coefficients)
    count = _OWN_PARAMETERS[camera.distortion]
    own, rest = camera.coefficients[:count], camera.coefficients[count:]
    return KalibrWords(camera.distortion, own + pinhole, "radtan" if rest else "none", rest)


def model_of_info(section: Section) -> CameraModel:
    """Model of a ROS CameraInfo, as camera_info_manager stores it or as echoed to a file."""
    intrinsics = section.key("camera_matrix", "K", "k")
    fx, _, cx, _, fy, cy, _, _, _ = section.some_numbers(intrinsics, 9)
    width = section.some_numbers(section.key("image_width", "width"), 1)[0]
    resolution = section.key("image_height", "height")
    height = section.some_numbers(resolution, 1)[0]
    coefficients = section.key("distortion_coefficients", "D", "d")
    return _checked(
        section, (resolution, intrinsics, coefficients), (width, height), (fx, fy, cx, cy)
    )


def camera_from_info(message: Any, rectified: bool = False) -> CameraModel:
    """Camera model of a `sensor_msgs/CameraInfo` message of ROS 1 (D, K, P) or ROS 2 (d, k, p).

    Args:
        message: of the images as they come from the camera, and of the rectified ones.
        rectified: whether the model of the latter is wanted: P, without distortion.

    Raises:
        CalibrationError: for an uncalibrated camera or an unsupported distortion model.
    """
    if rectified:
        projection = np.reshape(message.P if hasattr(message, "P") else message.p, (3, 4))
        distortion, coefficients = "none", np.zeros(0)
        name, matrix = "P", projection[:, :3].ravel()
    else:
        distortion = str(message.distortion_model)
        coefficients = message.D if hasattr(message, "D") else message.d
        name, matrix = "K", message.K if hasattr(message, "K") else message.k
    values: dict[str, Any] = {
        "distortion_model": distortion,
        name: [str(float(x)) for x in matrix],
        "D": [str(float(x)) for x in coefficients],
    }
    section = Section("CameraInfo message", "", values)
    fx, _, cx, _, fy, cy, _, _, _ = section.some_numbers(name, 9)
    size = float(message.width), float(message.height)
    return _checked(section, ("height", name, "D"), size, (fx, fy, cx, cy))


def _checked(
    section: Section,
    keys: tuple[str, str, str],
    size: tuple[float, float],
    intrinsics: tuple[float, float, float, float],
) -> CameraModel:
    """The model, when it is plausible; `keys` name size, intrinsics and coefficients in errors."""
    (size_key, intrinsics_key, coefficients_key), (width, height) = keys, size
    fx, fy, cx, cy = intrinsics
    if not all(length.is_integer() and 1.0 <= length <= _LARGEST_IMAGE for length in size):
        raise section.error(size_key, f"= {width:g} x {height:g} is no image size in pixels")
    longer = max(width, height)
    if not all(_FOCAL_LENGTH[0] <= f / longer <= _FOCAL_LENGTH[1] for f in (fx, fy)):
        raise section.error(
            intrinsics_key,
            f"has focal lengths {fx:g}, {fy:g}, implausible for {width:g} x {height:g} pixels",
        )
    if not (-width <= cx <= 2.0 * width and -height <= cy <= 2.0 * height):
        raise section.error(
            intrinsics_key, f"has its principal point {cx:g}, {cy:g} far outside the image"
        )
    word = section.text("distortion_model")
    if word not in _DISTORTION:
        raise section.error(
            "distortion_model",
            f"{word[:40]!r} is not supported; calibrate with radtan (plumb_bob) or equidistant",
        )
    distortion = _DISTORTION[word]
    coefficients = section.numbers(coefficients_key) if coefficients_key in section.values else []
    if distortion == "radtan":
        if any(coefficients[5:]):
            raise section.error(
                coefficients_key,
                "uses the rational model, which is not supported; calibrate with plumb_bob",
            )
        coefficients = coefficients[:5]
    if not coefficients and section.key("K", "k", "camera_matrix") in section.values:
        distortion = "none"  # so ROS describes a rectified image
    if distortion == "none" and not any(coefficients):
        coefficients = []
    try:
        model = CameraModel(
            int(width), int(height), fx, fy, cx, cy, distortion, tuple(coefficients)
        )
    except RuledgraphError as error:
        raise section.error(coefficients_key, f"do not fit: {error}") from None
    seen, places = _places_seen(model)
    if seen < _PLACES_SEEN * places:
        raise section.error(
            coefficients_key, f"leave {seen} of the image's {places} places a viewing ray"
        )
    return model


def _places_seen(model: CameraModel) -> tuple[int, int]:
    """Of how many places of the image there is a viewing ray, and how many were looked at."""
    shares = (np.arange(_PLACES) + 0.5) / _PLACES
    u, v = np.meshgrid(shares * model.width, shares * model.height)
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    with np.errstate(all="ignore"):
        rays = model.undistort(pixels)
    # Beyond a fold a polynomial leads to the other side of the axis.
    pinhole = (pixels - [model.cx, model.cy]) / [model.fx, model.fy]
    return int(np.count_nonzero(np.sum(rays * pinhole, axis=1) >= 0.0)), len(pixels)
