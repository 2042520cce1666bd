# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""C++ factors in Python, with a GTSAM of one's own: the same as those in Python, and clonable."""

import dataclasses
import gc
from importlib.util import find_spec

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from random_factors import FORMS, POINTS, random_case
from ruledgraph_factors import (
    FactorError,
    RuledSurfaceSpec,
    check_lines,
    clone_graph,
    gtsam_self_test,
    native_factor,
    spec_of,
)
from ruledgraph_factors.gtsam_self_test import BOUND, self_test

BUILT = find_spec("ruledgraph_factors._gtsam") is not None
needs_module = pytest.mark.skipif(
    not BUILT, reason="no ruledgraph_factors._gtsam: it needs a GTSAM of your own, see CPP.md"
)


@pytest.mark.skipif(BUILT, reason="ruledgraph_factors._gtsam is built")
def test_without_the_module_it_says_what_is_missing() -> None:
    with pytest.raises(FactorError, match=r"a GTSAM of your own, see CPP\.md: .*'_gtsam'"):
        native_factor(random_case(0).factor("node").spec)
    fits, text = self_test()
    assert not fits
    assert text.startswith("ruledgraph_factors._gtsam does not fit this GTSAM: ")
    assert "see CPP.md" in text
    assert "\n" not in text


def test_the_self_test_outlives_a_module_that_takes_down_the_process() -> None:
    fits, text = self_test("import os; os.kill(os.getpid(), 11)")
    assert not fits
    assert text.endswith(": the test died of SIGSEGV")


@needs_module
def test_the_self_test_finds_that_the_module_fits() -> None:
    fits, text = self_test()
    assert fits, text


@needs_module
def test_the_self_test_finds_a_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    def slightly_off(spec: RuledSurfaceSpec) -> gtsam.NoiseModelFactor:
        return native_factor(dataclasses.replace(spec, gravity=spec.gravity * (1.0 + 1e-9)))

    monkeypatch.setattr(gtsam_self_test, "native_factor", slightly_off)
    with pytest.raises(FactorError, match="error and Jacobian differ from Python's by"):
        gtsam_self_test.compare()


@needs_module
@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("form", FORMS)
def test_it_is_the_factor_in_python(form: str, kind: type) -> None:
    case = random_case(3)
    python = case.factor(form, kind, sigma=0.1)
    native = native_factor(python.spec)
    assert list(native.keys()) == list(python.keys())
    assert native.error(case.values) == pytest.approx(python.error(case.values), rel=BOUND)
    ours, theirs = (f.linearize(case.values).augmentedJacobian() for f in (python, native))
    assert np.abs(theirs - ours).max() <= BOUND * np.abs(ours).max()


@needs_module
def test_gtsam_clones_it_and_its_spec_is_found_again() -> None:
    case = random_case(5)
    spec = case.factor("node").spec
    graph = gtsam.NonlinearFactorGraph()
    graph.add(native_factor(spec))
    error = graph.error(case.values)
    copies = [graph.clone(), clone_graph(graph)]
    graph.resize(0)
    gc.collect()
    for copy in copies:
        factor = copy.at(0)
        assert not isinstance(factor, gtsam.CustomFactor)
        assert copy.error(case.values) == error
        found = spec_of(factor)
        assert isinstance(found, RuledSurfaceSpec)
        assert (found.keys, found.points) == (spec.keys, spec.points)


@needs_module
def test_the_spec_of_a_copy_has_its_keys_and_noise() -> None:
    spec = random_case(5).factor("pose").spec
    noise = gtsam.noiseModel.Isotropic.Sigma(spec.rows, 7.0)
    native = native_factor(spec)
    moved, noisy = (
        spec_of(native.rekey([X(8), L(9)])),
        spec_of(native.cloneWithNewNoiseModel(noise)),
    )
    assert moved is not None
    assert noisy is not None
    assert moved.keys == (X(8), L(9))
    assert noisy.noise_model.equals(noise, 0.0)


@needs_module
def test_check_lines_sees_it() -> None:
    case = random_case(5)
    python = case.factor("node", sigma=0.02)
    checks = []
    for factor in (python, native_factor(python.spec)):
        graph = gtsam.NonlinearFactorGraph()
        graph.add(factor)
        checks += check_lines(graph, case.values)
    assert len(checks) == 2
    assert checks[0].chi_squared == pytest.approx(checks[1].chi_squared, rel=BOUND)
    assert checks[0].expected == checks[1].expected
