# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What all factors of this package have in common: a spec of plain data, and the way back to it."""

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, TypeVar

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.noise import noise_to_dict
from ruledgraph_factors.npz_file import read_parts, write_parts
from ruledgraph_factors.validation import FloatArray, finite_array, graph_key

_Spec = TypeVar("_Spec", bound="FactorSpec")
_Factor = TypeVar("_Factor", bound="SpecFactor")


class SpecParts(NamedTuple):
    """A spec as plain data."""

    header: dict[str, Any]
    """Of str, int and lists."""
    arrays: dict[str, Any]
    """Numpy arrays by name."""


@dataclass(frozen=True, eq=False)
class FactorSpec(ABC):
    """A factor as plain data: what it takes to store it, send it elsewhere, build it again.

    GTSAM can neither clone, pickle nor serialise a Python `CustomFactor`; a spec can be all three,
    and `build_factor` makes an equal factor of it.
    """

    FORMAT: ClassVar[str]
    """Of `to_dict`: the name of the class and a version."""

    keys: tuple[int, ...]
    noise_model: noiseModel.Base

    @property
    @abstractmethod
    def rows(self) -> int:
        """Rows of the residual: the dimension of the noise model."""

    @property
    def rows_text(self) -> str:
        """The same in words."""
        return f"{self.rows} row{'s' if self.rows > 1 else ''}"

    @property
    @abstractmethod
    def charts(self) -> dict[int, LineChart]:
        """Of the lines among its keys: what it takes their values to be coordinates of."""

    @abstractmethod
    def _arrays(self) -> dict[str, Any]:
        """All numbers, by name."""

    @classmethod
    @abstractmethod
    def _from_parts(
        cls: type[_Spec], header: Mapping[str, Any], arrays: Mapping[str, Any]
    ) -> _Spec:
        """The inverse of `_header` and `_arrays`."""

    def _header(self) -> dict[str, Any]:
        return {
            "format": self.FORMAT,
            "keys": list(self.keys),
            "noise": noise_to_dict(self.noise_model),
        }

    def _check(self, names: tuple[str, ...]) -> None:
        """Keys and noise model."""
        keys = tuple(graph_key(name, key) for name, key in zip(names, self.keys, strict=True))
        for i, key in enumerate(keys):
            if key in keys[:i]:
                raise FactorError(f"{names[i]} is the same key as {names[keys.index(key)]}")
        object.__setattr__(self, "keys", keys)
        if not isinstance(self.noise_model, noiseModel.Base):
            raise FactorError(
                f"noise_model must be a gtsam.noiseModel, not {type(self.noise_model).__name__}"
            )

    def to_dict(self) -> dict[str, Any]:
        """Everything as str, int, float and lists: JSON keeps every bit of it.

        Raises:
            FactorError: when GTSAM cannot serialise the noise model (an m-estimator in Python).
        """
        header, arrays = self.to_parts()
        lists = {name: np.asarray(array).tolist() for name, array in arrays.items()}
        return {**header, "arrays": lists}

    def to_parts(self) -> "SpecParts":
        """The same in two parts, words and arrays."""
        return SpecParts(self._header(), self._arrays())

    @classmethod
    def from_dict(cls: type[_Spec], data: Mapping[str, Any]) -> _Spec:
        """The inverse of `to_dict`.

        Raises:
            FactorError: for data of another kind or with something missing.
        """
        if data.get("format") != cls.FORMAT:
            raise FactorError(f"format must be {cls.FORMAT!r}, not {data.get('format')!r}")
        try:
            return cls._from_parts(data, data["arrays"])
        except KeyError as error:
            raise FactorError(f"{error.args[0]} is missing from the spec") from None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an NPZ file; `load` reads it."""
        write_parts(path, *self.to_parts())

    @classmethod
    def load(cls: type[_Spec], path: str | os.PathLike[str]) -> _Spec:
        """The inverse of `save`.

        Raises:
            FactorError: for a file of another kind.
        """
        header, arrays = read_parts(path, cls.__name__)
        return cls.from_dict({**header, "arrays": arrays})

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self).from_dict, (self.to_dict(),)


class ErrorFunction(ABC):
    """The callback that GTSAM keeps of a factor.

    It holds no reference to the factor: that would be a cycle through C++ which Python's collector
    cannot see.
    """

    def __init__(self, spec: FactorSpec) -> None:
        self.spec = spec

    def __call__(
        self, this: gtsam.CustomFactor, values: gtsam.Values, H: list[FloatArray] | None
    ) -> FloatArray:
        """As GTSAM calls it."""
        if isinstance(values, _SpecRequest):
            values.answer(this, self.spec)
            return np.zeros(self.spec.rows)
        return self.error(this.keys(), values, H)

    @abstractmethod
    def error(
        self, keys: list[int], values: gtsam.Values, H: list[FloatArray] | None
    ) -> FloatArray:
        """The residual (rows,); fills H[i] (rows, tangent size of key i) unless it is None."""


class _SpecRequest(gtsam.Values):
    """Asks a factor for its spec. GTSAM hands its callback this very object, not a copy."""

    def __init__(self, factor: gtsam.CustomFactor) -> None:
        super().__init__()
        self._factor = factor
        self.spec: FactorSpec | None = None

    def answer(self, factor: gtsam.CustomFactor, spec: FactorSpec) -> None:
        """Called back by `factor`, which may be one that the factor asked evaluates in turn."""
        if factor is self._factor:
            self.spec = spec


class SpecFactor(gtsam.CustomFactor):
    """A factor that a spec describes; Python can pickle, copy and clone it."""

    spec: FactorSpec
    """The plain data this factor was built from."""

    def __init__(self, spec: FactorSpec, error: ErrorFunction) -> None:
        super().__init__(spec.noise_model, list(spec.keys), error)
        self.spec = spec
        if self.dim() != spec.rows:
            raise FactorError(
                f"noise_model has dimension {self.dim()}, but this factor has {spec.rows_text}"
            )

    def clone(self: _Factor) -> _Factor:
        """An equal factor, built anew."""
        return type(self)(self.spec)  # type: ignore[call-arg]  # of every subclass

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.spec,)

    def __copy__(self: _Factor) -> _Factor:
        return self.clone()


def spec_of(factor: gtsam.NonlinearFactor) -> FactorSpec | None:
    """The spec of a factor of this package, also when GTSAM hands it back from a graph as a plain
    `CustomFactor`, after Python has let go of it; None for any other factor. That of a
    `native_factor` has the keys and noise model that the factor has now.
    """
    if isinstance(factor, SpecFactor):
        return factor.spec
    native = getattr(factor, "spec", None)
    if isinstance(native, FactorSpec) and isinstance(factor, gtsam.NoiseModelFactor):
        return replace(native, keys=tuple(factor.keys()), noise_model=factor.noiseModel())
    if type(factor) is not gtsam.CustomFactor:
        return None
    request = _SpecRequest(factor)
    with suppress(Exception):  # someone else's callback may raise anything
        factor.unwhitenedError(request)
    return request.spec


def pose3(name: str, value: Any) -> gtsam.Pose3:
    """A pose of a spec's (4, 4) array."""
    return gtsam.Pose3(finite_array(name, value, (4, 4)))


def chart_arrays(chart: LineChart, prefix: str = "") -> dict[str, Any]:
    """A chart as arrays, named `prefix` and the attribute."""
    return {
        f"{prefix}world_T_anchor": chart.world_T_anchor.matrix(),
        f"{prefix}basis": chart.basis,
        f"{prefix}angle": np.float64(chart.angle),
    }


def chart_from(arrays: Mapping[str, Any], prefix: str = "") -> LineChart:
    """The inverse of `chart_arrays`."""
    anchor = pose3(f"{prefix}world_T_anchor", arrays[f"{prefix}world_T_anchor"])
    return LineChart(anchor, arrays[f"{prefix}basis"], float(arrays[f"{prefix}angle"]))
