# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The C++ factors for GTSAM 4.2 and 4.3: right by themselves, and the same as in Python."""

from pathlib import Path
from typing import get_args

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, E, F, G, L, T, V, X

from cpp import (
    CPP,
    Reader,
    build,
    build_with_gtsam,
    numbers_of,
    run,
    stand_in,
    together_group,
)
from numerics import factor_jacobians
from random_factors import FORMS, POINTS, Case, random_case
from ruledgraph_factors import (
    GeometricPoints,
    LineChart,
    RuledSurfaceFactor,
    line_distance_factor,
    new_line_factor,
    same_line_factor,
)
from ruledgraph_factors.factor_spec import SpecFactor
from ruledgraph_factors.line_distance import LineDistanceSpec
from ruledgraph_factors.new_line import NewLineSpec
from ruledgraph_factors.same_line import SameLineSpec
from ruledgraph_factors.spec import Form

SOURCE = CPP / "factor_test.cpp"
# In the order of `Kind` there.
KINDS = (*get_args(Form), NewLineSpec, LineDistanceSpec, SameLineSpec)
BOUND = 1e-12
# Each built once, not by each worker.
BUILDS = [
    pytest.param("4.2", marks=pytest.mark.xdist_group("GTSAM 4.2")),
    pytest.param("4.3", marks=together_group),
]


@pytest.fixture(scope="module", params=[*BUILDS, "real"])
def program(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    if request.param == "4.3":
        return request.getfixturevalue("together")
    folder = tmp_path_factory.mktemp("cpp")
    if request.param == "real":
        return build_with_gtsam(CPP, folder) / "factor_test"
    return build(SOURCE, folder, *stand_in(40200))


def chart_numbers(chart: LineChart) -> list[object]:
    return [chart.world_T_anchor, chart.basis, chart.angle]


def line_numbers(factor: SpecFactor, values: gtsam.Values) -> list[object]:
    """A factor on a line that does not observe it."""
    spec = factor.spec
    data = [KINDS.index(type(spec)), *chart_numbers(spec.chart)]
    if isinstance(spec, SameLineSpec):
        data += [spec.delta, *chart_numbers(spec.new_chart)]
        return data + [values.atVector(key) for key in spec.keys]
    data += [spec.world_T_body if isinstance(spec, NewLineSpec) else spec.distance]
    return [*data, values.atPose3(spec.keys[0]), values.atVector(spec.keys[1])]


def numbers(case: Case, factor: RuledSurfaceFactor) -> list[object]:
    """A factor and its values, as `factor_test.cpp` reads them."""
    spec, values = factor.spec, case.values
    motion = spec.motion
    frames = case.frames[: len(motion)]
    data: list[object] = [KINDS.index(spec.form)]
    data += [spec.has_time_offset, spec.has_extrinsics, spec.has_focal_ratio]
    data += [*chart_numbers(spec.chart), spec.body_T_cam]
    data += [motion.time_jacobian is not None, motion.bias, len(motion)]
    for i in range(len(motion)):
        data += [motion.elapsed[i], motion.preintegrated[i, :6], motion.bias_jacobian[i, :6]]
        if motion.time_jacobian is not None:
            data += [motion.time_jacobian[i]]
    data += [isinstance(spec.points, GeometricPoints), len(frames)]
    for frame in frames:
        data += [len(frame), frame]
    data += [spec.gravity]
    data += [values.atPose3(X(0)), values.atVector(V(0)), values.atConstantBias(B(0)).vector()]
    data += [values.atVector(L(0))]
    if spec.has_time_offset:
        data += [values.atDouble(T(0))]
    if spec.has_extrinsics:
        data += [values.atPose3(E(0))]
    if spec.has_focal_ratio:
        data += [values.atDouble(F(0))]
    if spec.form == "node_gravity_direction":
        data += [values.atUnit3(G(0)).unitVector()]
    elif spec.form == "node_gravity_vector":
        data += [values.atVector(G(1))]
    return data


def test_residuals_and_jacobians_are_those_of_python(program: Path) -> None:
    cases = [random_case(seed) for seed in range(3)]
    factors = [(c, c.factor(form, kind)) for c in cases for form in FORMS for kind in POINTS]
    text = numbers_of([part for case, factor in factors for part in numbers(case, factor)])
    found = Reader(run(program, text=text))
    for case, factor in factors:
        values = case.values
        residual = factor.unwhitenedError(values)
        jacobians = factor_jacobians(factor, values)
        theirs = found.take(residual.size)
        # QR leaves the signs of a compressed frame's rows open.
        signs = np.copysign(1.0, theirs) * np.copysign(1.0, residual)
        assert np.abs(signs * theirs - residual).max() <= BOUND * max(1.0, np.abs(residual).max())
        for key in factor.keys():  # noqa: SIM118 - a GTSAM factor is no dict
            expected = jacobians[key]
            block = signs[:, None] * found.take(expected.size).reshape(expected.shape)
            if key == G(0):
                # The basis of a Unit3's tangent plane is each library's own, the plane is not.
                expected, block = expected @ expected.T, block @ block.T
            assert np.abs(block - expected).max() <= BOUND * max(1.0, np.abs(expected).max())
    assert found.at_end


def line_factors(seed: int) -> list[tuple[SpecFactor, gtsam.Values]]:
    """Each of the factors on a line alone, where it stands near and where it has wrapped."""
    four, one = noiseModel.Unit.Create(4), noiseModel.Unit.Create(1)
    factors = []
    for number, scale in enumerate((0.1, 2.0)):
        case = random_case(10 * number + seed)
        rng, chart, pose = case.rng, case.chart, case.values.atPose3(X(0))
        delta = rng.normal(size=4) * 0.2
        new_chart, _ = chart.reanchor(delta, pose)
        values = gtsam.Values()
        values.insert(X(0), pose.retract(rng.normal(size=6) * 0.1))
        values.insert(L(0), rng.normal(size=4) * scale)
        values.insert(L(1), rng.normal(size=4) * scale)
        factors += [
            (new_line_factor(four, X(0), L(0), chart, pose), values),
            (line_distance_factor(one, X(0), L(0), chart, 2.5), values),
            (same_line_factor(four, L(0), L(1), chart, delta, new_chart), values),
        ]
    return factors


def test_factors_on_a_line_alone_are_those_of_python(program: Path) -> None:
    factors = [found for seed in range(3) for found in line_factors(seed)]
    text = numbers_of([part for factor, values in factors for part in line_numbers(factor, values)])
    found = Reader(run(program, text=text))
    for factor, values in factors:
        residual, jacobians = factor.unwhitenedError(values), factor_jacobians(factor, values)
        for expected in (residual, *(jacobians[key] for key in factor.spec.keys)):
            scale = max(1.0, np.abs(expected).max())
            assert np.abs(found.take(expected.size) - expected.ravel()).max() <= BOUND * scale
    assert found.at_end
