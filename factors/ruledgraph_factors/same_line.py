# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""One line under two keys: how a long-lived line gets a new chart without losing information."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import gtsam
import numpy as np
from gtsam import noiseModel
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.factor_spec import (
    ErrorFunction,
    FactorSpec,
    SpecFactor,
    chart_arrays,
    chart_from,
)
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.noise import noise_from_dict
from ruledgraph_factors.validation import FloatArray, finite_array, instance, vector_of

# How far (norm of delta) the old estimate may be off the new chart's reference: rounding.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class SameLineSpec(FactorSpec):
    """Everything that defines a `same_line_factor`, by the names of its arguments."""

    FORMAT: ClassVar[str] = "ruledgraph_factors.SameLineSpec/1"

    chart: LineChart
    delta: FloatArray
    new_chart: LineChart

    def __post_init__(self) -> None:
        self._check(("line_key", "new_line_key"))
        instance("chart", self.chart, LineChart)
        instance("new_chart", self.new_chart, LineChart)
        object.__setattr__(self, "delta", finite_array("delta", self.delta, (4,)))

    @property
    def rows(self) -> int:
        """Of delta."""
        return 4

    @property
    def charts(self) -> dict[int, LineChart]:
        """Of the line under both keys."""
        return {self.keys[0]: self.chart, self.keys[1]: self.new_chart}

    def _arrays(self) -> dict[str, Any]:
        old, new = chart_arrays(self.chart), chart_arrays(self.new_chart, "new_")
        return {**old, **new, "delta": self.delta}

    @classmethod
    def _from_parts(cls, header: Mapping[str, Any], arrays: Mapping[str, Any]) -> "SameLineSpec":
        return cls(
            tuple(header["keys"]),
            noise_from_dict(header["noise"]),
            chart_from(arrays),
            arrays["delta"],
            chart_from(arrays, "new_"),
        )


class SameLineFactor(SpecFactor):
    """The factor that a spec describes."""

    spec: SameLineSpec

    def __init__(self, spec: SameLineSpec) -> None:
        super().__init__(spec, _SameLineError(spec))


class _SameLineError(ErrorFunction):
    def __init__(self, spec: SameLineSpec) -> None:
        super().__init__(spec)
        self._delta = spec.delta
        self._by_old = np.asfortranarray(_by_old(spec.chart, spec.delta, spec.new_chart))

    def error(
        self, keys: list[int], values: gtsam.Values, H: list[FloatArray] | None
    ) -> FloatArray:
        old, new = vector_of(values, keys[0], 4), vector_of(values, keys[1], 4)
        if H is not None:
            H[0], H[1] = self._by_old, -np.eye(4, order="F")
        return np.asarray(self._by_old @ (old - self._delta) - new)


def same_line_factor(
    noise_model: noiseModel.Base,
    line_key: int,
    new_line_key: int,
    chart: LineChart,
    delta: ArrayLike,
    new_chart: LineChart,
) -> SameLineFactor:
    """Ties a line's variable to another one of the same line in a new chart.

    Residual: r = J (delta_old - delta) - delta_new, (4,), with J of `LineChart.reanchor`. It is
    linear on purpose: smoothers with a fixed lag stop to linearise a variable anew once a neighbour
    has left the window, and J belongs where the line is now, not where it was then. That is when
    to use this factor, too: as soon as a line's estimate has moved away from the point it is
    linearised at. Insert the new variable as zeros(4) and use its key from then on; the old one may
    leave the window, marginalised. The line's factors that are still in the window should go to the
    new variable, too (`RuledSurfaceSpec.with_line`): else they stay linear where the line was.

    Args:
        noise_model: of dimension 4, any kind. The marginal on the old variable is linear, and off
            by the second term of Taylor's series: by about |d|^2 / 2 (rad), where the estimate has
            moved by d since that variable was fixed. Unobservable directions of the marginal
            (position and yaw of the whole) are off by |d|: with such a factor they seem to be known
            to |d| / 2 (rad), and with a tighter one better, which is inconsistent.
        line_key: Vector4, in `chart`.
        new_line_key: Vector4, in the new chart.
        chart: of the old variable.
        delta: its estimate, (4,).
        new_chart: of the same line: `chart.reanchor(delta, ...)` or `chart.recentred(delta)`.

    Raises:
        FactorError: naming the argument that is wrong; or the new chart's reference is another
            line, or runs through its anchor.
    """
    here = finite_array("delta", delta, (4,))
    spec = SameLineSpec((line_key, new_line_key), noise_model, chart, here, new_chart)
    return SameLineFactor(spec)


def _by_old(chart: LineChart, delta: FloatArray, new_chart: LineChart) -> FloatArray:
    """J, (4, 4)."""
    moment, direction = np.split(chart.plucker(delta)[0], 2)
    if np.linalg.norm(new_chart.local(moment, direction)) > _SAME:
        raise FactorError("new_chart: its reference is not the line at delta of chart")
    same, jacobian = chart.reanchor(delta, new_chart.world_T_anchor)
    # Its frame U may have other signs, s: then w' = s w and phi' = s_1 s_2 phi.
    signs = np.sign(np.diag(new_chart.basis.T @ same.basis))
    return np.asarray(np.append(signs[0] * signs[1], signs)[:, None] * jacobian)
