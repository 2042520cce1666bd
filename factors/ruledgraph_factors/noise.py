# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Noise models as plain data."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from gtsam import noiseModel

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.validation import FloatArray

# GTSAM reads an archive into an existing model of the same class; these are the smallest of each
# that do not collapse into a more special class (Isotropic of sigma 1 would become Unit).
_BLANK_NOISE: dict[str, Callable[[], Any]] = {
    "Unit": lambda: noiseModel.Unit.Create(1),
    "Isotropic": lambda: noiseModel.Isotropic.Sigma(1, 2.0),
    "Diagonal": lambda: noiseModel.Diagonal.Sigmas(np.array([1.0, 2.0])),
    "Constrained": lambda: noiseModel.Constrained.All(1),
    "Gaussian": lambda: noiseModel.Gaussian.SqrtInformation(np.array([[1.0, 0.5], [0.0, 1.0]])),
    "Robust": lambda: noiseModel.Robust.Create(
        noiseModel.mEstimator.Huber.Create(1.0), noiseModel.Unit.Create(1)
    ),
}

# Squared Mahalanobis distances at which a loss and a restored one are compared.
_SQUARES = (1.0, 30.0, 1e3)


def noise_to_dict(model: noiseModel.Base) -> dict[str, str]:
    """The model's class and GTSAM's own text archive of it.

    Raises:
        FactorError: for a model that the archive does not hold: an m-estimator written in Python,
            and Tukey's losses, whose constant GTSAM does not restore, but for the default one.
    """
    kind = type(model).__name__
    if kind not in _BLANK_NOISE:
        raise FactorError(f"noise_model: a {kind} cannot be serialised")
    archive = model.serialize()  # type: ignore[attr-defined]
    if "mEstimator::Custom " in archive:  # GTSAM drops its Python functions without a word
        raise FactorError("noise_model: an m-estimator written in Python cannot be serialised")
    data = {"type": kind, "archive": archive}
    if isinstance(model, noiseModel.Robust):
        restored = noise_from_dict(data)
        if any(restored.loss(square) != model.loss(square) for square in _SQUARES):
            raise FactorError(
                "noise_model: GTSAM's archive does not hold the constant of this loss, as of "
                "Tukey's: it cannot be copied or stored; use another, such as mEstimator.Welsch"
            )
    return data


def noise_from_dict(data: Mapping[str, str]) -> noiseModel.Base:
    """The inverse of `noise_to_dict`."""
    kind = data["type"]
    if kind not in _BLANK_NOISE:
        raise FactorError(f"noise: unknown type {kind!r}")
    model: noiseModel.Base = _BLANK_NOISE[kind]()
    try:
        model.deserialize(data["archive"])  # type: ignore[attr-defined]
    except RuntimeError as error:
        raise FactorError(f"noise: GTSAM cannot read the archive: {error}") from None
    return model


def whitened_square(model: noiseModel.Base, residual: FloatArray) -> float:
    """Squared norm of the whitened residual; of a robust model without its loss."""
    if isinstance(model, noiseModel.Robust):
        model = model.noise()
    whitened = model.whiten(residual)
    return float(whitened @ whitened)
