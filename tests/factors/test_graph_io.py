# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Graphs of our factors and native ones, copied and stored."""

import gc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, L, V, X

from random_factors import FORMS, random_case
from ruledgraph_factors import (
    FactorError,
    RuledSurfaceSpec,
    build_factor,
    clone_graph,
    line_distance_factor,
    load_graph,
    new_line_factor,
    same_line_factor,
    save_graph,
    spec_of,
)

HUBER = noiseModel.mEstimator.Huber.Create(1.345)


def robust(rows: int) -> noiseModel.Robust:
    return noiseModel.Robust.Create(HUBER, noiseModel.Isotropic.Sigma(rows, 0.1))


def mixed_graph() -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Every factor of ours, some with robust noise, native ones, and an empty slot."""
    case = random_case(7)
    values, chart = gtsam.Values(case.values), case.chart
    delta = values.atVector(L(0))
    new_chart, _ = chart.recentred(delta)
    values.insert(L(1), np.full(4, 0.01))
    values.insert(X(1), values.atPose3(X(0)))
    values.insert(V(1), values.atVector(V(0)))
    values.insert(B(1), values.atConstantBias(B(0)))
    imu = gtsam.PreintegratedCombinedMeasurements(
        gtsam.PreintegrationCombinedParams.MakeSharedU(9.81)
    )
    imu.integrateMeasurement(np.array([0.1, 0.0, 9.81]), np.array([0.1, 0.0, 0.2]), 0.01)
    graph = gtsam.NonlinearFactorGraph()
    graph.addPriorPose3(X(0), gtsam.Pose3(), noiseModel.Isotropic.Sigma(6, 0.1))
    for form in FORMS:
        graph.add(case.factor(form, sigma=0.02))
    graph.add(gtsam.CombinedImuFactor(X(0), V(0), X(1), V(1), B(0), B(1), imu))
    graph.add(new_line_factor(robust(4), X(0), L(0), chart, gtsam.Pose3()))
    graph.add(same_line_factor(robust(4), L(0), L(1), chart, delta, new_chart))
    graph.add(line_distance_factor(robust(1), X(0), L(0), chart, 3.0))
    graph.addPriorVector(L(0), np.zeros(4), noiseModel.Unit.Create(4))
    graph.remove(0)
    return graph, values


def assert_equal(
    ours: gtsam.NonlinearFactorGraph, theirs: gtsam.NonlinearFactorGraph, values: gtsam.Values
) -> None:
    assert ours.size() == theirs.size()
    for index in range(ours.size()):
        assert ours.exists(index) == theirs.exists(index)
        if ours.exists(index):
            one, other = ours.at(index), theirs.at(index)
            assert one.keys() == other.keys()
            assert one.error(values) == other.error(values)
            np.testing.assert_array_equal(
                one.linearize(values).augmentedJacobian(),
                other.linearize(values).augmentedJacobian(),
            )


def test_a_clone_is_equal_and_another() -> None:
    graph, values = mixed_graph()
    gc.collect()  # Python lets go of the factors; the graph keeps them
    copy = clone_graph(graph)
    assert_equal(copy, graph, values)
    copy.remove(1)
    assert graph.exists(1)


def test_a_file_keeps_all_of_a_graph(tmp_path: Path) -> None:
    graph, values = mixed_graph()
    save_graph(graph, tmp_path / "graph.npz")
    assert_equal(load_graph(tmp_path / "graph.npz"), graph, values)


def test_the_spec_comes_back_from_what_gtsam_hands_out() -> None:
    graph, _ = mixed_graph()
    gc.collect()
    spec = spec_of(graph.at(1))
    assert type(graph.at(1)) is gtsam.CustomFactor
    assert isinstance(spec, RuledSurfaceSpec)
    assert build_factor(spec).spec.to_dict() == spec.to_dict()
    assert spec_of(graph.at(graph.size() - 1)) is None


def test_empty_values_give_the_error_of_values_that_lack_a_key() -> None:
    factor = random_case(1).factor("pose")
    with pytest.raises(RuntimeError, match='the key "x0", which does not exist'):
        factor.unwhitenedError(gtsam.Values())
    some = gtsam.Values()
    some.insert(X(1), gtsam.Pose3())
    messages = []
    for values in (gtsam.Values(), some):
        with pytest.raises(RuntimeError) as raised:
            factor.error(values)
        messages.append(str(raised.value))
    assert messages[0] == messages[1]


def test_the_spec_comes_back_in_every_thread_and_of_a_copy() -> None:
    graph, _ = mixed_graph()
    copy = clone_graph(graph)
    gc.collect()
    for each in (graph, copy):
        with ThreadPoolExecutor(4) as pool:
            found = list(pool.map(lambda _, at=each: spec_of(at.at(1)), range(200)))
        assert all(isinstance(spec, RuledSurfaceSpec) for spec in found)


def test_a_foreign_factor_that_evaluates_one_of_ours_has_no_spec() -> None:
    ours = random_case(1).factor("pose")
    foreign = gtsam.CustomFactor(
        ours.spec.noise_model, ours.keys(), lambda _, values, __: ours.unwhitenedError(values)
    )
    assert spec_of(foreign) is None
    assert spec_of(ours) is ours.spec


def test_foreign_custom_factors_and_files_are_named(tmp_path: Path) -> None:
    graph, _ = mixed_graph()
    foreign = gtsam.CustomFactor(noiseModel.Unit.Create(1), [X(0)], lambda *_: np.zeros(1))
    graph.add(foreign)
    with pytest.raises(FactorError, match=f"factor {graph.size() - 1} is a CustomFactor"):
        clone_graph(graph)
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(FactorError, match=r"other.npz holds no graph"):
        load_graph(tmp_path / "other.npz")


def test_a_file_with_factors_of_another_version_is_named(tmp_path: Path) -> None:
    graph, _ = mixed_graph()
    save_graph(graph, tmp_path / "graph.npz")
    with np.load(tmp_path / "graph.npz") as file:
        parts = dict(file)
    header = str(parts["header"]).replace("RuledSurfaceSpec/2", "RuledSurfaceSpec/1")
    np.savez(tmp_path / "older.npz", **{**parts, "header": np.array(header)})
    with pytest.raises(FactorError, match=r"factors of format '.*RuledSurfaceSpec/1', not one of"):
        load_graph(tmp_path / "older.npz")


def write_nothing(path: Path) -> None:
    path.write_bytes(b"")


def write_text(path: Path) -> None:
    path.write_text("0 1 2\n")


def write_one_array(path: Path) -> None:
    with path.open("wb") as file:
        np.save(file, np.zeros(3))


def write_other_header(path: Path) -> None:
    np.savez(path, header=np.array("no JSON"))


def write_half_a_file(path: Path) -> None:
    save_graph(mixed_graph()[0], path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])


FILES = (write_nothing, write_text, write_one_array, write_other_header, write_half_a_file)


@pytest.mark.parametrize("write", FILES)
def test_files_of_other_kinds_are_named(write: Callable[[Path], None], tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    write(path)
    with pytest.raises(FactorError, match=r"other\.npz holds no graph of save_graph"):
        load_graph(path)
    with pytest.raises(FactorError, match=r"other\.npz holds no RuledSurfaceSpec"):
        RuledSurfaceSpec.load(path)


def test_a_file_that_does_not_exist_stays_an_error_of_the_system(tmp_path: Path) -> None:
    for load in (load_graph, RuledSurfaceSpec.load):
        with pytest.raises(FileNotFoundError):
            load(tmp_path / "none.npz")


@pytest.mark.parametrize("loss", ["Tukey", "AsymmetricTukey"])
def test_a_loss_that_gtsam_does_not_restore_is_refused_of_native_factors(
    loss: str, tmp_path: Path
) -> None:
    graph, _ = mixed_graph()
    estimator = getattr(noiseModel.mEstimator, loss).Create(40.0)
    graph.addPriorPose3(
        X(0), gtsam.Pose3(), noiseModel.Robust.Create(estimator, noiseModel.Unit.Create(6))
    )
    with pytest.raises(FactorError, match=f"factor {graph.size() - 1}: .* hold the constant"):
        save_graph(graph, tmp_path / "graph.npz")
    assert not (tmp_path / "graph.npz").exists()


def test_other_robust_native_factors_are_kept(tmp_path: Path) -> None:
    graph, values = mixed_graph()
    graph.addPriorPose3(X(0), gtsam.Pose3(), robust(6))
    save_graph(graph, tmp_path / "graph.npz")
    assert_equal(load_graph(tmp_path / "graph.npz"), graph, values)
