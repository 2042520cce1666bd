# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Graphs with our factors, copied and stored: what GTSAM can do with native factors alone."""

import os
from collections.abc import Iterator
from typing import Any

import gtsam
from gtsam import noiseModel

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.factor import RuledSurfaceFactor
from ruledgraph_factors.factor_spec import FactorSpec, SpecFactor, spec_of
from ruledgraph_factors.line_distance import LineDistanceFactor, LineDistanceSpec
from ruledgraph_factors.new_line import NewLineFactor, NewLineSpec
from ruledgraph_factors.noise import noise_to_dict
from ruledgraph_factors.npz_file import read_parts, write_parts
from ruledgraph_factors.same_line import SameLineFactor, SameLineSpec
from ruledgraph_factors.spec import RuledSurfaceSpec

_FORMAT, _CONTENT = "ruledgraph_factors.graph/1", "graph of save_graph"
_FACTORS: dict[type[FactorSpec], Any] = {
    RuledSurfaceSpec: RuledSurfaceFactor,
    NewLineSpec: NewLineFactor,
    SameLineSpec: SameLineFactor,
    LineDistanceSpec: LineDistanceFactor,
}
_SPECS = {spec.FORMAT: spec for spec in _FACTORS}


def build_factor(spec: FactorSpec) -> SpecFactor:
    """The factor that a spec describes."""
    factor: SpecFactor = _FACTORS[type(spec)](spec)
    return factor


def clone_graph(graph: gtsam.NonlinearFactorGraph) -> gtsam.NonlinearFactorGraph:
    """A deep copy of a graph: ours are built anew, native factors cloned, empty slots kept.

    Raises:
        FactorError: for a factor that is neither (another `CustomFactor`), with its index.
    """
    copy = gtsam.NonlinearFactorGraph()
    copy.resize(graph.size())
    for index, factor, spec in _factors(graph):
        in_python = isinstance(factor, gtsam.CustomFactor)
        copy.replace(index, build_factor(spec) if spec and in_python else factor.clone())
    return copy


def save_graph(graph: gtsam.NonlinearFactorGraph, path: str | os.PathLike[str]) -> None:
    """Write a graph to an NPZ file; `load_graph` reads it.

    Native factors go in as GTSAM's own archive, which a GTSAM of another version may not read.

    Raises:
        FactorError: for a factor that cannot be stored, with its index: another `CustomFactor`, a
            robust noise model written in Python or with a constant that GTSAM does not restore
            (Tukey's), a native factor without serialisation.
    """
    native = gtsam.NonlinearFactorGraph()
    native.resize(graph.size())
    headers: dict[str, Any] = {}
    arrays: dict[str, Any] = {}
    for index, factor, spec in _factors(graph):
        try:
            if spec is None:
                _require_storable_loss(factor)
                native.replace(index, factor)
                continue
            parts = spec.to_parts()
        except FactorError as error:
            raise FactorError(f"graph: factor {index}: {error}") from None
        headers[str(index)] = parts.header
        arrays |= {f"{index}.{name}": array for name, array in parts.arrays.items()}
    try:
        archive = native.serialize()
    except RuntimeError as error:
        raise FactorError(f"graph: GTSAM cannot store one of its factors: {error}") from None
    header = {"format": _FORMAT, "size": graph.size(), "native": archive, "factors": headers}
    write_parts(path, header, arrays)


def load_graph(path: str | os.PathLike[str]) -> gtsam.NonlinearFactorGraph:
    """The inverse of `save_graph`.

    Raises:
        FactorError: for a file of another kind, or an archive that this GTSAM cannot read.
    """
    header, arrays = read_parts(path, _CONTENT)
    if header.get("format") != _FORMAT:
        raise FactorError(f"{os.fspath(path)} holds no {_CONTENT}")
    graph = gtsam.NonlinearFactorGraph()
    try:
        graph.deserialize(header["native"])
    except RuntimeError as error:
        raise FactorError(f"{os.fspath(path)}: GTSAM cannot read its factors: {error}") from None
    own: dict[str, dict[str, Any]] = {index: {} for index in header["factors"]}
    for name, array in arrays.items():
        index, _, attribute = name.partition(".")
        own[index][attribute] = array
    for index, parts in header["factors"].items():
        kind = _SPECS.get(parts["format"])
        if kind is None:
            raise FactorError(
                f"{os.fspath(path)} holds factors of format {parts['format']!r}, not one of "
                f"{', '.join(_SPECS)}"
            )
        spec = kind.from_dict({**parts, "arrays": own[index]})
        graph.replace(int(index), build_factor(spec))
    return graph


def _require_storable_loss(factor: gtsam.NonlinearFactor) -> None:
    """Of a native factor: GTSAM's archive would change some losses without a word."""
    model = factor.noiseModel() if isinstance(factor, gtsam.NoiseModelFactor) else None
    if isinstance(model, noiseModel.Robust):
        noise_to_dict(model)


def _factors(
    graph: gtsam.NonlinearFactorGraph,
) -> Iterator[tuple[int, gtsam.NonlinearFactor, FactorSpec | None]]:
    """Index, factor and spec, if it is ours, of all factors."""
    for index in range(graph.size()):
        if not graph.exists(index):
            continue
        factor = graph.at(index)
        spec = spec_of(factor)
        if spec is None and isinstance(factor, gtsam.CustomFactor):
            raise FactorError(f"graph: factor {index} is a CustomFactor of another package")
        yield index, factor, spec
