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

Form: TypeAlias = Literal[
    "node",
    "node_time_offset",
    "node_extrinsics",
    "node_time_offset_extrinsics",
    "node_gravity_direction",
    "node_gravity_vector",
    "pose",
    "pose_extrinsics",
]
"""Which variables a factor connects, see `KEY_NAMES`."""

_NODE = ("pose_key", "velocity_key", "bias_key")
KEY_NAMES: dict[Form, tuple[str, ...]] = {
    "node": (*_NODE, "line_key"),
    "node_time_offset": (*_NODE, "time_key", "line_key"),
    "node_extrinsics": (*_NODE, "extrinsics_key", "line_key"),
    "node_time_offset_extrinsics": (*_NODE, "time_key", "extrinsics_key", "line_key"),
    "node_gravity_direction": (*_NODE, "gravity_key", "line_key"),
    "node_gravity_vector": (*_NODE, "gravity_key", "line_key"),
    "pose": ("pose_key", "line_key"),
    "pose_extrinsics": ("pose_key", "extrinsics_key", "line_key"),
}


@dataclass(frozen=True, eq=False)
class RuledSurfaceSpec(FactorSpec):
    """Everything that defines a point-to-ruled-surface factor.

    `keys` are in the order of `KEY_NAMES[form]`; `noise_model` is of dimension `points.rows`, of
    one point of weight 1 in normalised image units.

    Raises:
        FactorError: for input no factor can be built from; the message names the argument.
    """

    FORMAT: ClassVar[str] = "ruledgraph_factors.RuledSurfaceSpec/1"

    form: Form
    chart: LineChart
    motion: FrameMotion
    points: GeometricPoints | ReprojectionPoints
    body_T_cam: gtsam.Pose3
    """In the forms with extrinsics it is a variable and this is not used."""
    gravity: FloatArray
    """World gravity, (3,), m/s^2; in the form "node_gravity_direction" only its norm counts, in
    "node_gravity_vector" and "pose" it is not used."""

    def __post_init__(self) -> None:
        if self.form not in get_args(Form):
            raise FactorError(f"form must be one of {', '.join(get_args(Form))}, not {self.form!r}")
        names = KEY_NAMES[self.form]
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
    def has_extrinsics(self) -> bool:
        """Whether the camera's pose in the body is a variable, the last key but one."""
        return self.form.endswith("extrinsics")

    @property
    def has_time_offset(self) -> bool:
        """Whether the frames' shift in time is a variable, `keys[3]`."""
        return self.form.startswith("node_time_offset")

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

    def with_line(self, line_key: int, chart: LineChart) -> "RuledSurfaceSpec":
        """The same observation of a line that has a new chart and key."""
        return replace(self, keys=(*self.keys[:-1], line_key), chart=chart)

    def with_noise(self, noise_model: noiseModel.Base) -> "RuledSurfaceSpec":
        """The same with another noise model."""
        return replace(self, noise_model=noise_model)

    def _header(self) -> dict[str, Any]:
        return {**super()._header(), "form": self.form}

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
        )
