# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A factor as plain data: what it takes to store it, send it to another process, build it again.

GTSAM can neither clone, pickle nor serialise a Python `CustomFactor`; a `RuledSurfaceSpec` can be
all three and rebuilds an equal factor: `RuledSurfaceFactor(spec)`.
"""

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.motion import FrameMotion
from ruledgraph_factors.observations import CompressedPoints, IndividualPoints
from ruledgraph_factors.validation import FloatArray, finite_array, graph_key, instance, pose

Form: TypeAlias = Literal[
    "knot", "knot_time_offset", "knot_gravity_direction", "knot_gravity_vector", "pose"
]
"""Which variables a factor connects, see `KEY_NAMES`."""

KEY_NAMES: dict[Form, tuple[str, ...]] = {
    "knot": ("pose_key", "velocity_key", "bias_key", "line_key"),
    "knot_time_offset": ("pose_key", "velocity_key", "bias_key", "time_key", "line_key"),
    "knot_gravity_direction": ("pose_key", "velocity_key", "bias_key", "gravity_key", "line_key"),
    "knot_gravity_vector": ("pose_key", "velocity_key", "bias_key", "gravity_key", "line_key"),
    "pose": ("pose_key", "line_key"),
}

_FORMAT = "ruledgraph_factors.RuledSurfaceSpec/1"

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


@dataclass(frozen=True, eq=False)
class RuledSurfaceSpec:
    """Everything that defines a point-to-ruled-surface factor.

    Raises:
        FactorError: for input no factor can be built from; the message names the argument.
    """

    form: Form
    keys: tuple[int, ...]
    """In the order of `KEY_NAMES[form]`."""
    noise_model: noiseModel.Base
    """Of dimension `points.rows`; of one point of weight 1 in normalised image units."""
    chart: LineChart
    motion: FrameMotion
    points: CompressedPoints | IndividualPoints
    body_T_cam: gtsam.Pose3
    gravity: FloatArray
    """World gravity, (3,), m/s^2; in the form "knot_gravity_direction" only its norm counts, in
    "knot_gravity_vector" and "pose" it is not used."""

    def __post_init__(self) -> None:
        if self.form not in get_args(Form):
            raise FactorError(f"form must be one of {', '.join(get_args(Form))}, not {self.form!r}")
        names = KEY_NAMES[self.form]
        if len(self.keys) != len(names):
            raise FactorError(
                f"keys: the form {self.form!r} takes {len(names)}: {', '.join(names)}"
            )
        keys = tuple(graph_key(name, key) for name, key in zip(names, self.keys, strict=True))
        for i, key in enumerate(keys):
            if key in keys[:i]:
                raise FactorError(f"{names[i]} is the same key as {names[keys.index(key)]}")
        object.__setattr__(self, "keys", keys)
        if not isinstance(self.noise_model, noiseModel.Base):
            raise FactorError(
                f"noise_model must be a gtsam.noiseModel, not {type(self.noise_model).__name__}"
            )
        instance("chart", self.chart, LineChart)
        instance("motion", self.motion, FrameMotion)
        if not isinstance(self.points, CompressedPoints | IndividualPoints):
            raise FactorError(
                "points must be CompressedPoints or IndividualPoints (see their from_frames), "
                f"not {type(self.points).__name__}"
            )
        if self.points.frames != len(self.motion):
            raise FactorError(
                f"points has {self.points.frames} frames, but motion has {len(self.motion)}"
            )
        if self.form == "knot_time_offset" and self.motion.time_jacobian is None:
            raise FactorError(
                "motion has no time_jacobian: use preintegrate_frames(..., with_time=True)"
            )
        pose("body_T_cam", self.body_T_cam)
        object.__setattr__(self, "gravity", finite_array("gravity", self.gravity, (3,)))

    # -- plain data ------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """Everything as str, int, float and lists: JSON keeps every bit of it.

        Raises:
            FactorError: when GTSAM cannot serialise the noise model (an m-estimator in Python).
        """
        arrays = {name: array.tolist() for name, array in self._arrays().items()}
        return {**self._header(), "arrays": arrays}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "RuledSurfaceSpec":
        """The inverse of `to_dict`.

        Raises:
            FactorError: for data of another kind or with something missing.
        """
        if data.get("format") != _FORMAT:
            raise FactorError(f"format must be {_FORMAT!r}, not {data.get('format')!r}")
        try:
            arrays: Mapping[str, Any] = data["arrays"]
            points: CompressedPoints | IndividualPoints
            if "statistics" in arrays:
                points = CompressedPoints(arrays["statistics"])
            else:
                points = IndividualPoints(arrays["points"], arrays["sqrt_weights"], arrays["frame"])
            return cls(
                form=data["form"],
                keys=tuple(data["keys"]),
                noise_model=_noise_from_dict(data["noise"]),
                chart=LineChart(
                    _pose3("world_T_anchor", arrays["world_T_anchor"]),
                    arrays["basis"],
                    float(arrays["angle"]),
                ),
                motion=FrameMotion(
                    arrays["elapsed"],
                    arrays["preintegrated"],
                    arrays["bias_jacobian"],
                    arrays["bias"],
                    arrays.get("time_jacobian"),
                ),
                points=points,
                body_T_cam=_pose3("body_T_cam", arrays["body_T_cam"]),
                gravity=arrays["gravity"],
            )
        except KeyError as error:
            raise FactorError(f"{error.args[0]} is missing from the spec") from None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an NPZ file; `load` reads it."""
        header = json.dumps(self._header())
        with Path(path).open("wb") as file:
            np.savez_compressed(file, header=np.array(header), **self._arrays())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "RuledSurfaceSpec":
        """The inverse of `save`.

        Raises:
            FactorError: for a file of another kind.
        """
        with np.load(path, allow_pickle=False) as file:
            if "header" not in file:
                raise FactorError(f"{os.fspath(path)} holds no RuledSurfaceSpec")
            arrays = {name: file[name] for name in file.files if name != "header"}
            return cls.from_dict({**json.loads(str(file["header"])), "arrays": arrays})

    def __reduce__(self) -> tuple[Any, ...]:
        return RuledSurfaceSpec.from_dict, (self.to_dict(),)

    def _header(self) -> dict[str, Any]:
        return {
            "format": _FORMAT,
            "form": self.form,
            "keys": list(self.keys),
            "noise": _noise_to_dict(self.noise_model),
        }

    def _arrays(self) -> dict[str, Any]:
        arrays: dict[str, Any] = {
            "world_T_anchor": self.chart.world_T_anchor.matrix(),
            "basis": self.chart.basis,
            "angle": np.float64(self.chart.angle),
            "elapsed": self.motion.elapsed,
            "preintegrated": self.motion.preintegrated,
            "bias_jacobian": self.motion.bias_jacobian,
            "bias": self.motion.bias,
            "body_T_cam": self.body_T_cam.matrix(),
            "gravity": self.gravity,
        }
        if self.motion.time_jacobian is not None:
            arrays["time_jacobian"] = self.motion.time_jacobian
        if isinstance(self.points, CompressedPoints):
            arrays["statistics"] = self.points.statistics
        else:
            arrays["points"] = self.points.points
            arrays["sqrt_weights"] = self.points.sqrt_weights
            arrays["frame"] = self.points.frame
        return arrays


def _pose3(name: str, value: Any) -> gtsam.Pose3:
    return gtsam.Pose3(finite_array(name, value, (4, 4)))


def _noise_to_dict(model: noiseModel.Base) -> dict[str, str]:
    """The model's class and GTSAM's own text archive of it, exact for every model GTSAM has."""
    kind = type(model).__name__
    if kind not in _BLANK_NOISE:
        raise FactorError(f"noise_model: a {kind} cannot be serialised")
    archive = model.serialize()  # type: ignore[attr-defined]
    if "mEstimator::Custom " in archive:  # GTSAM drops its Python functions without a word
        raise FactorError("noise_model: an m-estimator written in Python cannot be serialised")
    return {"type": kind, "archive": archive}


def _noise_from_dict(data: Mapping[str, str]) -> noiseModel.Base:
    kind = data["type"]
    if kind not in _BLANK_NOISE:
        raise FactorError(f"noise: unknown type {kind!r}")
    model: noiseModel.Base = _BLANK_NOISE[kind]()
    try:
        model.deserialize(data["archive"])  # type: ignore[attr-defined]
    except RuntimeError as error:
        raise FactorError(f"noise: GTSAM cannot read the archive: {error}") from None
    return model
