# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How far away a line is about, before anything shows it."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, TypeAlias

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph_factors.factor_spec import (
    ErrorFunction,
    FactorSpec,
    SpecFactor,
    chart_arrays,
    chart_from,
)
from ruledgraph_factors.kernel import active_kernel, native
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.noise import noise_from_dict
from ruledgraph_factors.so3 import hat
from ruledgraph_factors.validation import FloatArray, instance, positive_number, vector_of

_Angle: TypeAlias = Callable[[FloatArray, gtsam.Pose3], tuple[float, FloatArray, FloatArray]]
# `line_angle` of a chart.

# So close to the pose or to infinity (rad) the logarithm goes on straight.
_STRAIGHT = 0.05


@dataclass(frozen=True, eq=False)
class LineDistanceSpec(FactorSpec):
    """Everything that defines a `line_distance_factor`, by the names of its arguments."""

    FORMAT: ClassVar[str] = "ruledgraph_factors.LineDistanceSpec/1"

    chart: LineChart
    distance: float

    def __post_init__(self) -> None:
        self._check(("pose_key", "line_key"))
        instance("chart", self.chart, LineChart)
        object.__setattr__(self, "distance", positive_number("distance", self.distance))

    @property
    def rows(self) -> int:
        """One, the logarithm."""
        return 1

    @property
    def charts(self) -> dict[int, LineChart]:
        """Of the line."""
        return {self.keys[-1]: self.chart}

    def _arrays(self) -> dict[str, Any]:
        return {**chart_arrays(self.chart), "distance": np.float64(self.distance)}

    @classmethod
    def _from_parts(
        cls, header: Mapping[str, Any], arrays: Mapping[str, Any]
    ) -> "LineDistanceSpec":
        return cls(
            tuple(header["keys"]),
            noise_from_dict(header["noise"]),
            chart_from(arrays),
            float(arrays["distance"]),
        )


class LineDistanceFactor(SpecFactor):
    """The factor that a spec describes."""

    spec: LineDistanceSpec

    def __init__(self, spec: LineDistanceSpec) -> None:
        super().__init__(spec, _LineDistanceError(spec))


class _LineDistanceError(ErrorFunction):
    def __init__(self, spec: LineDistanceSpec) -> None:
        super().__init__(spec)
        self._log_distance = math.log(spec.distance)
        self._angle = _angle_of(spec.chart)

    def error(
        self, keys: list[int], values: gtsam.Values, H: list[FloatArray] | None
    ) -> FloatArray:
        pose, delta = values.atPose3(keys[0]), vector_of(values, keys[1], 4)
        phi, by_pose, by_line = self._angle(delta, pose)
        # To the logarithm's range and back: r(phi) and its slope beyond it are those at its end.
        inside = min(max(phi, _STRAIGHT), 0.5 * math.pi - _STRAIGHT)
        slope = 2.0 / math.sin(2.0 * inside)
        if H is not None:
            H[0] = slope * by_pose[None]
            H[1] = slope * by_line[None]
        value = math.log(math.tan(inside)) + self._log_distance + slope * (phi - inside)
        return np.array([value])


def line_distance_factor(
    noise_model: noiseModel.Base, pose_key: int, line_key: int, chart: LineChart, distance: float
) -> LineDistanceFactor:
    """A line is about so far from a pose, give or take a factor.

    Residual: r = log(tan(phi) distance), (1,), with tan(phi) the line's inverse distance from the
    pose's origin: phi = atan2(sin(phi_A), |m|), m the moment about it at the scale of the chart,
    phi_A the chart's angle, whose sign it takes. Where the line comes close to infinity or to the
    pose it goes on along the tangent, so that it is defined for every line.

    A line along the motion shows no depth, and a small error of the velocity across it looks like
    depth: a normal prior on the chart then gives way and the line goes to infinity, where it holds
    the camera no longer. This one does not give way. It is no prior on the line alone: with a
    distance from a fixed position each line would also constrain the unobservable position.

    Args:
        noise_model: of dimension 1, any kind, of the logarithm of the distance: log(4) for 1 / 4
            to 4 times.
        pose_key: Pose3, world_T_body of a state that saw the line.
        line_key: Vector4, delta of `chart`.
        chart: of the line.
        distance: median, m.

    Raises:
        FactorError: naming the argument that is wrong.
    """
    return LineDistanceFactor(LineDistanceSpec((pose_key, line_key), noise_model, chart, distance))


def line_angle(
    chart: LineChart, delta: FloatArray, pose: gtsam.Pose3
) -> tuple[float, FloatArray, FloatArray]:
    """phi, and its derivatives by the pose, (6,), and by delta, (4,)."""
    return _angle_of(chart)(delta, pose)


def _angle_of(chart: LineChart) -> _Angle:
    if active_kernel() == "numpy":
        return partial(line_angle_in_numpy, chart)
    constants = chart.world_T_anchor.matrix(), chart.basis, chart.angle
    return lambda delta, pose: native.line_angle(*constants, delta, pose.matrix())


def line_angle_in_numpy(
    chart: LineChart, delta: FloatArray, pose: gtsam.Pose3
) -> tuple[float, FloatArray, FloatArray]:
    """The reference of `_native.line_angle`."""
    if not np.isfinite(delta).all():  # as of the native kernel: a chart would raise
        return math.nan, np.full(6, math.nan), np.full(4, math.nan)
    place, rotation = pose.translation(), pose.rotation().matrix()
    plucker, by_delta = chart.plucker(delta)
    direction, across = plucker[3:], hat(place)
    moment = plucker[:3] - across @ direction
    moment_by_delta = by_delta[:3] - across @ by_delta[3:]
    size = max(float(np.linalg.norm(moment)), 1e-12)
    sine, cosine = math.sin(chart.angle + delta[0]), math.cos(chart.angle + delta[0])
    # d atan2(sine, size) = (size d sine - sine d size) / (size^2 + sine^2)
    by_size = -sine / (size**2 + sine**2) * (moment / size)
    by_line = by_size @ moment_by_delta
    by_line[0] += size * cosine / (size**2 + sine**2)
    by_pose = np.concatenate([np.zeros(3), by_size @ hat(direction) @ rotation])
    return math.atan2(sine, size), by_pose, by_line
