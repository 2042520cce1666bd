# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""All lines of a frame at once: rulings and what is found along them, in arrays, a row each."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ruledgraph.edges.gradient import Gradient
from ruledgraph.edges.search import EdgePoints, Ruling, search
from ruledgraph.sensors import CameraModel, FloatArray
from ruledgraph_factors import active_kernel

try:
    import ruledgraph.edges._native_search as native
except ModuleNotFoundError:  # installed where there was no C++ compiler
    native = None  # type: ignore[assignment]


class Rulings(NamedTuple):
    """N of `Ruling`."""

    ends: FloatArray
    """(N, 2, 2), normalised."""
    sigmas: FloatArray
    """(N, 2), px."""
    slopes: FloatArray
    """(N,)."""

    def part(self, rows: NDArray[np.bool_] | Sequence[int]) -> "Rulings":
        """Some of them."""
        return Rulings(self.ends[rows], self.sigmas[rows], self.slopes[rows])

    def one_by_one(self) -> list[Ruling]:
        """As `search` takes them."""
        return [
            Ruling(ends, (first, second), slope)
            for ends, (first, second), slope in zip(
                self.ends, self.sigmas.tolist(), self.slopes.tolist(), strict=True
            )
        ]


class Edges(NamedTuple):
    """What counts of N `EdgePoints`."""

    counts: NDArray[np.int64]
    """How many points each has, (N,); 0: there is no such line, and its row has no meaning."""
    points: FloatArray
    """One line's after the other's, (M, 2)."""
    lines: FloatArray
    """(N, 2), px."""
    support: FloatArray
    deviation: FloatArray
    slopes: FloatArray
    ambiguous: NDArray[np.bool_]

    def part(self, rows: NDArray[np.bool_]) -> "Edges":
        """Those of a mask, (N,)."""
        return Edges(
            counts=self.counts[rows],
            points=self.points[np.repeat(rows, self.counts)],
            lines=self.lines[rows],
            support=self.support[rows],
            deviation=self.deviation[rows],
            slopes=self.slopes[rows],
            ambiguous=self.ambiguous[rows],
        )

    def points_of_each(self) -> list[FloatArray]:
        """Views, N of (N_i, 2)."""
        ends = np.cumsum(self.counts)
        starts = (ends - self.counts).tolist()
        return [self.points[a:b] for a, b in zip(starts, ends.tolist(), strict=True)]


def stacked(found: Sequence[EdgePoints | None]) -> Edges:
    """What `search` found one by one."""
    n = len(found)
    edges = Edges(
        counts=np.zeros(n, np.int64),
        points=np.concatenate([np.zeros((0, 2)), *(e.points for e in found if e is not None)]),
        lines=np.zeros((n, 2)),
        support=np.zeros(n),
        deviation=np.zeros(n),
        slopes=np.zeros(n),
        ambiguous=np.zeros(n, np.bool_),
    )
    for i, edge in enumerate(found):
        if edge is not None:
            edges.counts[i], edges.lines[i] = len(edge.points), edge.line
            edges.support[i], edges.deviation[i] = edge.support, edge.deviation
            edges.slopes[i], edges.ambiguous[i] = edge.slope, edge.ambiguous
    return edges


def search_all(
    gradient: Gradient, camera: CameraModel, rulings: Rulings, beyond: float = 0.0
) -> Edges:
    """`search` of every ruling, by the native kernel if there is one.

    Raises:
        FactorError: when the environment asks for a kernel that there is not.
    """
    if active_kernel() == "numpy" or native is None:
        return stacked([search(gradient, camera, each, beyond) for each in rulings.one_by_one()])
    return Edges(*native.search_all(gradient.xy, native.Camera(**vars(camera)), *rulings, beyond))
