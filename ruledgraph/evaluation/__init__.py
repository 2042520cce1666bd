# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of trajectories and lines against ground truth.

evo computes what evo knows, ATE and RPE. It is under the GPL, version 3: `by_evo` alone imports it,
and only when something is evaluated. The measures of the paper's tables are in `paper_measures`.
"""

from ruledgraph.evaluation.by_evo import (
    ALIGNMENTS,
    Accuracy,
    Alignment,
    Comparison,
    Errors,
    accuracy,
    compare,
)
from ruledgraph.evaluation.matching import EvaluationError, alignment, matched
from ruledgraph.evaluation.paper_measures import (
    AxisDifferences,
    LineDistances,
    axis_differences,
    first_pose_alignment,
    line_distances,
    point_line_distances,
)

__all__ = [
    "ALIGNMENTS",
    "Accuracy",
    "Alignment",
    "AxisDifferences",
    "Comparison",
    "Errors",
    "EvaluationError",
    "LineDistances",
    "accuracy",
    "alignment",
    "axis_differences",
    "compare",
    "first_pose_alignment",
    "line_distances",
    "matched",
    "point_line_distances",
]
