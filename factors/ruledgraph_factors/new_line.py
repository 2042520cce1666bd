# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A prior on a new line that says nothing of where in the world it is."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.factor_spec import (
    ErrorFunction,
    FactorSpec,
    SpecFactor,
    chart_arrays,
    chart_from,
    pose3,
)
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.noise import noise_from_dict
from ruledgraph_factors.so3 import hat
from ruledgraph_factors.validation import FloatArray, instance, pose, vector_of

_IDENTITY = np.eye(4, order="F")


@dataclass(frozen=True, eq=False)
class NewLineSpec(FactorSpec):
    """Everything that defines a `new_line_factor`, by the names of its arguments."""

    FORMAT: ClassVar[str] = "ruledgraph_factors.NewLineSpec/1"

    chart: LineChart
    world_T_body: gtsam.Pose3

    def __post_init__(self) -> None:
        self._check(("pose_key", "line_key"))
        instance("chart", self.chart, LineChart)
        pose("world_T_body", self.world_T_body)

    @property
    def rows(self) -> int:
        """Of delta."""
        return 4

    @property
    def charts(self) -> dict[int, LineChart]:
        """Of the line."""
        return {self.keys[-1]: self.chart}

    def _arrays(self) -> dict[str, Any]:
        return {**chart_arrays(self.chart), "world_T_body": self.world_T_body.matrix()}

    @classmethod
    def _from_parts(cls, header: Mapping[str, Any], arrays: Mapping[str, Any]) -> "NewLineSpec":
        return cls(
            tuple(header["keys"]),
            noise_from_dict(header["noise"]),
            chart_from(arrays),
            pose3("world_T_body", arrays["world_T_body"]),
        )


class NewLineFactor(SpecFactor):
    """The factor that a spec describes."""

    spec: NewLineSpec

    def __init__(self, spec: NewLineSpec) -> None:
        super().__init__(spec, _NewLineError(spec))


class _NewLineError(ErrorFunction):
    def __init__(self, spec: NewLineSpec) -> None:
        super().__init__(spec)
        self._chart, self._start = spec.chart, spec.world_T_body
        self._by_pose = np.asfortranarray(-moved_with(spec.chart, spec.world_T_body))

    def error(
        self, keys: list[int], values: gtsam.Values, H: list[FloatArray] | None
    ) -> FloatArray:
        moved = self._start.localCoordinates(values.atPose3(keys[0]))
        delta, by_line = vector_of(values, keys[1], 4), _IDENTITY
        if self._chart.is_far(delta):
            delta, by_line = self._chart.wrapped(delta)
        if H is not None:
            H[0], H[1] = self._by_pose, np.asfortranarray(by_line)
        return np.asarray(delta + self._by_pose @ moved)


def new_line_factor(
    noise_model: noiseModel.Base,
    pose_key: int,
    line_key: int,
    chart: LineChart,
    world_T_body: gtsam.Pose3,
) -> NewLineFactor:
    """As seen from a pose, a line is about where its chart's reference is.

    Residual: r = delta - F xi, (4,), with xi the pose's coordinates (rotation first) at
    `world_T_body` and F the derivative of delta when the line moves with the pose:

        F xi = (sin(phi)^2 u3 . t,  u1 . w,  u2 . w - tan(phi) u1 . t,  u3 . w)

    w and t being the pose's turn and its shift at the anchor's centre, in the anchor frame, and
    u1, u2, u3, phi the chart's. Of a line that has wrapped (`LineChart.is_far`) delta is the
    smallest, so that it is not drawn back all the way that it came.

    The Jacobian by the pose is -F, a constant. The derivative is -F times Logmap's, so -F is exact
    at xi = 0 and off by a share of up to |xi| / 2 elsewhere: by 5 % where the pose has turned by
    0.1 rad since. With deviations of 1 rad and more (`NEW_LINE_SIGMAS`) that is nothing beside the
    points of a line; with narrow ones it would move the minimum.

    A prior on delta alone would be one in the world frame. Those of all lines that come and go add
    up and constrain the unobservable position and yaw of the poses.

    Args:
        noise_model: of dimension 4, any kind, of delta (rad), such as `NEW_LINE_SIGMAS`.
        pose_key: Pose3, world_T_body of a state that saw the line.
        line_key: Vector4, delta of `chart`.
        chart: of the line.
        world_T_body: estimate of the pose, from which the reference line was made.

    Raises:
        FactorError: naming the argument that is wrong; or the reference line runs through the
            anchor.
    """
    return NewLineFactor(NewLineSpec((pose_key, line_key), noise_model, chart, world_T_body))


def moved_with(chart: LineChart, world_T_body: gtsam.Pose3) -> FloatArray:
    """F, (4, 6): the derivative of the reference line's delta when it moves with a pose.

    Raises:
        FactorError: when the reference line runs through the anchor.
    """
    sine, cosine = np.sin(chart.angle), np.cos(chart.angle)
    if abs(cosine) < 1e-6:
        raise FactorError("chart: its reference line runs through its anchor")
    anchor_T_body = chart.world_T_anchor.between(world_T_body)
    turn = anchor_T_body.rotation().matrix()
    shift = np.hstack([hat(anchor_T_body.translation()) @ turn, turn])
    by_turn = np.hstack([chart.basis.T @ turn, np.zeros((3, 3))])
    by_shift = chart.basis.T @ shift
    return np.array(
        [
            sine**2 * by_shift[2],
            by_turn[0],
            by_turn[1] - sine / cosine * by_shift[0],
            by_turn[2],
        ]
    )
