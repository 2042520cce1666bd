# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Specs rebuild equal factors after JSON, NPZ and pickle."""

import copy
import dataclasses
import json
import pickle
from pathlib import Path

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel

from random_factors import FORMS, POINTS, random_case
from ruledgraph_factors import FactorError, RuledSurfaceFactor, RuledSurfaceSpec


def noise_models(rows: int) -> list[noiseModel.Base]:
    rng = np.random.default_rng(rows)
    root = rng.normal(size=(rows, rows))
    full = noiseModel.Gaussian.Covariance(root @ root.T + np.eye(rows))
    m = noiseModel.mEstimator
    return [
        noiseModel.Unit.Create(rows),
        noiseModel.Isotropic.Sigma(rows, 1.0 / 600.0),
        noiseModel.Diagonal.Sigmas(rng.uniform(0.1, 0.2, size=rows)),
        full,
        noiseModel.Robust.Create(m.Huber.Create(1.345), noiseModel.Isotropic.Sigma(rows, 0.1)),
        noiseModel.Robust.Create(m.Cauchy.Create(0.7), full),
        noiseModel.Robust.Create(m.Tukey.Create(4.6851), full),
    ]


def assert_equal(rebuilt: RuledSurfaceFactor, factor: RuledSurfaceFactor, values) -> None:
    assert rebuilt.keys() == factor.keys()
    assert rebuilt.error(values) == factor.error(values)
    for ours, theirs in zip(
        rebuilt.linearize(values).jacobian(), factor.linearize(values).jacobian(), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("form", FORMS)
def test_round_trips_rebuild_an_equal_factor(form: str, kind, tmp_path: Path) -> None:
    case = random_case(7)
    factor = case.factor(form, kind, sigma=0.02)
    spec = factor.spec
    through_json = RuledSurfaceSpec.from_dict(json.loads(json.dumps(spec.to_dict())))
    assert_equal(RuledSurfaceFactor(through_json), factor, case.values)
    spec.save(tmp_path / "factor.npz")
    through_npz = RuledSurfaceSpec.load(tmp_path / "factor.npz")
    assert_equal(RuledSurfaceFactor(through_npz), factor, case.values)
    assert through_npz.to_dict() == spec.to_dict()
    assert_equal(pickle.loads(pickle.dumps(factor)), factor, case.values)


@pytest.mark.parametrize("index", range(7))
def test_every_noise_model_survives(index: int) -> None:
    case = random_case(3)
    spec = case.factor("node").spec
    model = noise_models(spec.points.rows)[index]
    factor = RuledSurfaceFactor(dataclasses.replace(spec, noise_model=model))
    rebuilt = RuledSurfaceFactor(RuledSurfaceSpec.from_dict(factor.spec.to_dict()))
    assert type(rebuilt.spec.noise_model) is type(model)
    assert_equal(rebuilt, factor, case.values)


@pytest.mark.parametrize("loss", ["Tukey", "AsymmetricTukey"])
def test_a_loss_that_gtsam_does_not_restore_is_refused(loss: str) -> None:
    """Its archive has the constant, but not the square that is computed with."""
    spec = random_case(3).factor("node").spec
    estimator = getattr(noiseModel.mEstimator, loss).Create(40.0)
    unit = noiseModel.Unit.Create(spec.points.rows)
    robust = noiseModel.Robust.Create(estimator, unit)
    factor = RuledSurfaceFactor(dataclasses.replace(spec, noise_model=robust))
    for store in (lambda f: f.spec.to_dict(), pickle.dumps, copy.deepcopy):
        with pytest.raises(FactorError, match="does not hold the constant"):
            store(factor)


def test_a_factor_under_other_keys_is_a_replaced_spec() -> None:
    case = random_case(3)
    spec = case.factor("pose").spec
    moved = RuledSurfaceFactor(dataclasses.replace(spec, keys=(70, 80)))
    values = gtsam.Values()
    values.insert(70, case.values.atPose3(spec.keys[0]))
    values.insert(80, case.values.atVector(spec.keys[1]))
    assert moved.error(values) == case.factor("pose").error(case.values)


def test_largest_key_survives_json() -> None:
    spec = dataclasses.replace(random_case(3).factor("pose").spec, keys=(2**64 - 1, 2**63 + 1))
    again = RuledSurfaceSpec.from_dict(json.loads(json.dumps(spec.to_dict())))
    assert again.keys == (2**64 - 1, 2**63 + 1)


def plain_spec() -> dict:
    return json.loads(json.dumps(random_case(3).factor("node").spec.to_dict()))


def without(data: dict, *path: str) -> dict:
    inner = data
    for name in path[:-1]:
        inner = inner[name]
    del inner[path[-1]]
    return data


def changed(data: dict, name: str, value: object) -> dict:
    return {**data, name: value}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (dict, "format must be"),
        (lambda: changed(plain_spec(), "format", "other/1"), "format must be"),
        (lambda: without(plain_spec(), "keys"), "keys is missing from the spec"),
        (lambda: without(plain_spec(), "arrays", "basis"), "basis is missing from the spec"),
        (lambda: without(plain_spec(), "arrays", "statistics"), "points is missing"),
        (lambda: changed(plain_spec(), "form", "cube"), "form must be one of node, .*'cube'"),
        (lambda: changed(plain_spec(), "keys", [1, 2]), "keys: the form 'node' takes 4"),
        (lambda: changed(plain_spec(), "noise", {"type": "X", "archive": ""}), "noise: unknown"),
        (
            lambda: changed(plain_spec(), "noise", {"type": "Unit", "archive": "nonsense"}),
            "noise: GTSAM cannot read the archive",
        ),
    ],
)
def test_bad_data_is_named(make, message: str) -> None:
    with pytest.raises(FactorError, match=message):
        RuledSurfaceSpec.from_dict(make())


def test_foreign_file_is_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(FactorError, match=r"other.npz holds no RuledSurfaceSpec"):
        RuledSurfaceSpec.load(tmp_path / "other.npz")


def test_noise_model_in_python_cannot_be_stored() -> None:
    custom = noiseModel.mEstimator.Custom.Create(
        weight=lambda _: 1.0,
        loss=lambda e: 0.5 * e * e,
        reweight=noiseModel.mEstimator.Base.ReweightScheme.Block,
        name="mine",
    )
    spec = random_case(3).factor("node").spec
    model = noiseModel.Robust.Create(custom, noiseModel.Unit.Create(spec.points.rows))
    spec = dataclasses.replace(spec, noise_model=model)
    assert RuledSurfaceFactor(spec).dim() == spec.points.rows
    with pytest.raises(FactorError, match="noise_model: an m-estimator written in Python"):
        spec.to_dict()
