# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The C++ factors for GTSAM 4.2 and 4.3: right by themselves, and the same as in Python."""

from pathlib import Path

import numpy as np
import pytest
from gtsam.symbol_shorthand import B, G, L, T, V, X

from cpp import CPP, Reader, build, build_with_gtsam, numbers_of, run, stand_in
from numerics import factor_jacobians
from random_factors import FORMS, POINTS, Case, random_case
from ruledgraph_factors import GeometricPoints, RuledSurfaceFactor

SOURCE = CPP / "factor_test.cpp"
KINDS = ("node", "node_time_offset", "node_gravity_direction", "node_gravity_vector", "pose")
IN_CPP = [form for form in FORMS if form in KINDS]
BOUND = 1e-12


@pytest.fixture(scope="module", params=["stand-in", "real"])
def program(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cpp")
    if request.param == "real":
        return build_with_gtsam(CPP, folder) / "factor_test"
    return build(SOURCE, folder, *stand_in(40300))


def numbers(case: Case, factor: RuledSurfaceFactor) -> list[object]:
    """A factor and its values, as `factor_test.cpp` reads them."""
    spec, values = factor.spec, case.values
    motion = spec.motion
    frames = case.frames[: len(motion)]
    data: list[object] = [KINDS.index(spec.form)]
    data += [spec.chart.world_T_anchor, spec.chart.basis, spec.chart.angle, spec.body_T_cam]
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
    if spec.form == "node_time_offset":
        data += [values.atDouble(T(0))]
    elif spec.form == "node_gravity_direction":
        data += [values.atUnit3(G(0)).unitVector()]
    elif spec.form == "node_gravity_vector":
        data += [values.atVector(G(1))]
    return data


def test_residuals_and_jacobians_are_those_of_python(program: Path) -> None:
    cases = [random_case(seed) for seed in range(3)]
    factors = [(c, c.factor(form, kind)) for c in cases for form in IN_CPP for kind in POINTS]
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
