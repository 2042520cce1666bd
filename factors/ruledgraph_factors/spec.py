# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The point-to-ruled-surface factor as plain data."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import gtsam
from gtsam import noiseModel

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.factor_spec import FactorSpec, chart_arrays, chart_from, pose3
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.motion import FrameMotion
from ruledgraph_factors.noise import noise_from_dict
from ruledgraph_factors.observations import GeometricPoints, ReprojectionPoints
from ruledgraph_factors.validation import FloatArray, finite_array, instance, pose

Form: TypeAlias = Literal["node", "node_gravity_direction", "node_gravity_vector", "pose"]
"""Which variables a factor connects, beside the line and those of the camera."""

CameraVariable: TypeAlias = Literal["time", "extrinsics", "focal"]
"""What of the camera is a variable: the clock of its frames (double), its pose in the body (Pose3),
the ratio of its focal length to the one that points were normalised with (double)."""

_NODE = ("pose_key", "velocity_key", "bias_key")
_KEY_NAMES: dict[Form, tuple[str, ...]] = {
    "node": _NODE,
    "node_gravity_direction": (*_NODE, "gravity_key"),
    "node_gravity_vector": (*_NODE, "gravity_key"),
    "pose": ("pose_key",),
}
# A pose is given, not moved to the times of frames; gravity is a variable of a first window alone.
_OF_CAMERA: dict[Form, tuple[CameraVariable, ...]] = {
    "node": get_args(CameraVariable),
    "node_gravity_direction": (),
    "node_gravity_vector": (),
    "pose": ("extrinsics", "focal"),
}


@dataclass(frozen=True, eq=False)
class RuledSurfaceSpec(FactorSpec):
    """Everything that defines a point-to-ruled-surface factor.

    `keys` are in the order of `key_names`; `noise_model` is of dimension `points.rows`, of one
    point of weight 1 in normalised image units.

    Raises:
        FactorError: for input no factor can be built from; the message names the argument.
    """

    FORMAT: ClassVar[str] = "ruledgraph_factors.RuledSurfaceSpec/2"

    form: Form
    chart: LineChart
    motion: FrameMotion
    points: GeometricPoints | ReprojectionPoints
    body_T_cam: gtsam.Pose3
    """Not used where the extrinsics are a variable."""
    gravity: FloatArray
    """World gravity, (3,), m/s^2; in the form "node_gravity_direction" only its norm counts, in
    "node_gravity_vector" and "pose" it is not used."""
    camera_variables: tuple[CameraVariable, ...] = ()
    """Some of "time", "extrinsics" and "focal", in this order; "pose" has no time, and where
    gravity is a variable none of the camera is."""
    has_imu_noise: bool = False
    """Whether `with_imu_noise` made the noise model."""

    def __post_init__(self) -> None:
        if self.form not in get_args(Form):
            raise FactorError(f"form must be one of {', '.join(get_args(Form))}, not {self.form!r}")
        allowed, variables = _OF_CAMERA[self.form], tuple(self.camera_variables)
        if variables != tuple(name for name in allowed if name in variables):
            of = ", ".join(allowed) or "none"
            raise FactorError(
                f"camera_variables of the form {self.form!r} can be {of}, in this order, not "
                f"{variables!r}"
            )
        object.__setattr__(self, "camera_variables", variables)
        names = self.key_names
        if len(self.keys) != len(names):
            raise FactorError(
                f"keys: the form {self.form!r} takes {len(names)}: {', '.join(names)}"
            )
        self._check(names)
        instance("chart", self.chart, LineChart)
        instance("motion", self.motion, FrameMotion)
        if not isinstance(self.points, GeometricPoints | ReprojectionPoints):
            raise FactorError(
                "points must be GeometricPoints or ReprojectionPoints (see their from_frames), "
                f"not {type(self.points).__name__}"
            )
        if self.points.frames != len(self.motion):
            raise FactorError(
                f"points has {self.points.frames} frames, but motion has {len(self.motion)}"
            )
        if self.has_time_offset and self.motion.time_jacobian is None:
            raise FactorError(
                "motion has no time_jacobian: use preintegrate_frames(..., with_time=True)"
            )
        pose("body_T_cam", self.body_T_cam)
        object.__setattr__(self, "gravity", finite_array("gravity", self.gravity, (3,)))

    @property
    def key_names(self) -> tuple[str, ...]:
        """What each of `keys` is."""
        of_camera = (f"{name}_key" for name in self.camera_variables)
        return *_KEY_NAMES[self.form], *of_camera, "line_key"

    @property
    def has_extrinsics(self) -> bool:
        """Whether the camera's pose in the body is a variable."""
        return "extrinsics" in self.camera_variables

    @property
    def has_time_offset(self) -> bool:
        """Whether the frames' shift in time is a variable."""
        return "time" in self.camera_variables

    @property
    def has_focal_ratio(self) -> bool:
        """Whether the ratio of the focal length to the calibrated one is a variable."""
        return "focal" in self.camera_variables

    @property
    def rows(self) -> int:
        """Rows of the residual: three a frame, or two a point."""
        return self.points.rows

    @property
    def rows_text(self) -> str:
        """The same in words."""
        kind = "3 for each frame" if isinstance(self.points, GeometricPoints) else "2 a point"
        return f"{self.rows} rows ({kind})"

    @property
    def line_key(self) -> int:
        """Key of the line, the last of `keys`."""
        return self.keys[-1]

    @property
    def charts(self) -> dict[int, LineChart]:
        """Of the line."""
        return {self.keys[-1]: self.chart}

    def with_line(self, line_key: int, chart: LineChart) -> "RuledSurfaceSpec":
        """The same observation of a line that has a new chart and key."""
        return replace(self, keys=(*self.keys[:-1], line_key), chart=chart)

    def with_noise(self, noise_model: noiseModel.Base) -> "RuledSurfaceSpec":
        """The same with another noise model, of the points alone."""
        return replace(self, noise_model=noise_model, has_imu_noise=False)

    def _header(self) -> dict[str, Any]:
        return {
            **super()._header(),
            "form": self.form,
            "camera_variables": list(self.camera_variables),
            "has_imu_noise": self.has_imu_noise,
        }

    def _arrays(self) -> dict[str, Any]:
        arrays: dict[str, Any] = {
            **chart_arrays(self.chart),
            "elapsed": self.motion.elapsed,
            "preintegrated": self.motion.preintegrated,
            "bias_jacobian": self.motion.bias_jacobian,
            "bias": self.motion.bias,
            "body_T_cam": self.body_T_cam.matrix(),
            "gravity": self.gravity,
        }
        if self.motion.time_jacobian is not None:
            arrays["time_jacobian"] = self.motion.time_jacobian
        if isinstance(self.points, GeometricPoints):
            arrays["statistics"] = self.points.statistics
        else:
            arrays["points"] = self.points.points
            arrays["sqrt_weights"] = self.points.sqrt_weights
            arrays["frame"] = self.points.frame
        return arrays

    @classmethod
    def _from_parts(
        cls, header: Mapping[str, Any], arrays: Mapping[str, Any]
    ) -> "RuledSurfaceSpec":
        points: GeometricPoints | ReprojectionPoints
        if "statistics" in arrays:
            points = GeometricPoints(arrays["statistics"])
        else:
            points = ReprojectionPoints(arrays["points"], arrays["sqrt_weights"], arrays["frame"])
        return cls(
            form=header["form"],
            keys=tuple(header["keys"]),
            noise_model=noise_from_dict(header["noise"]),
            chart=chart_from(arrays),
            motion=FrameMotion(
                arrays["elapsed"],
                arrays["preintegrated"],
                arrays["bias_jacobian"],
                arrays["bias"],
                arrays.get("time_jacobian"),
            ),
            points=points,
            body_T_cam=pose3("body_T_cam", arrays["body_T_cam"]),
            gravity=arrays["gravity"],
            camera_variables=tuple(header["camera_variables"]),
            # Not in files of before it was there.
            has_imu_noise=bool(header.get("has_imu_noise", False)),
        )
