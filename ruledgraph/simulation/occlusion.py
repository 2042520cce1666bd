# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The order in which to paint surfaces so that the nearer ones hide the farther ones.

Source: binary space partitioning, Fuchs, Kedem and Naylor 1980. Surfaces that stand in each other's
way are cut where their planes meet, so that an exact order exists from everywhere.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.simulation.scene import Surface, edge_key

# Edges of a fragment that are no border of its surface, and borders that no other surface shares.
CUT = -2
FREE = -1
# Points this close to a plane lie on it, m.
_ON = 1e-6
# How many planes to try before choosing one to cut by.
_TRIED = 12
# Large surfaces are cut into pieces of about this size, m, each small enough for one resolution.
_PIECE = 2.0
_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


@dataclass(frozen=True, eq=False)
class Fragment:
    """A convex piece of a surface."""

    surface: int
    vertices: FloatArray
    """Clockwise as seen, (k, 3), m."""
    edges: tuple[int, ...]
    """For the edge from each vertex to the next: CUT, FREE or the surface on its other side."""


@dataclass(frozen=True, eq=False)
class _Node:
    normal: FloatArray
    offset: float
    here: list[int]
    front: "_Node | None"
    back: "_Node | None"


class PaintersOrder:
    """Fragments of a scene, and their order from back to front.

    Attributes:
        fragments: of all surfaces.
    """

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        self.fragments: list[Fragment] = []
        shell: list[Fragment] = []
        inside: list[Fragment] = []
        for fragment in _pieces(surfaces):
            (shell if surfaces[fragment.surface].is_shell else inside).append(fragment)
        # The shell is convex and around everything: it comes first.
        self._shell = [self._add(fragment) for fragment in shell]
        self._root = self._build(inside, surfaces)

    def _add(self, fragment: Fragment) -> int:
        self.fragments.append(fragment)
        return len(self.fragments) - 1

    def _build(self, fragments: list[Fragment], surfaces: Sequence[Surface]) -> _Node | None:
        if not fragments:
            return None
        tried = fragments[:: max(1, len(fragments) // _TRIED)]
        plane = min(
            (_plane(surfaces[f.surface]) for f in tried), key=lambda p: _cost(fragments, *p)
        )
        here: list[int] = []
        front: list[Fragment] = []
        back: list[Fragment] = []
        for fragment in fragments:
            height = fragment.vertices @ plane[0] - plane[1]
            if np.all(np.abs(height) <= _ON):
                here.append(self._add(fragment))
            elif np.all(height >= -_ON):
                front.append(fragment)
            elif np.all(height <= _ON):
                back.append(fragment)
            else:
                front.append(_half(fragment, height))
                back.append(_half(fragment, -height))
        return _Node(*plane, here, self._build(front, surfaces), self._build(back, surfaces))

    def seen_from(self, eye: FloatArray) -> Iterator[int]:
        """Indices of all fragments, the farther ones first."""
        yield from self._shell
        stack: list[_Node | list[int] | None] = [self._root]
        while stack:
            node = stack.pop()
            if isinstance(node, list):
                yield from node
            elif node is not None:
                in_front = eye @ node.normal > node.offset
                near, far = (node.front, node.back) if in_front else (node.back, node.front)
                stack += [near, node.here, far]


def _plane(surface: Surface) -> tuple[FloatArray, float]:
    return surface.normal, float(surface.normal @ surface.corner)


def _cost(fragments: Sequence[Fragment], normal: FloatArray, offset: float) -> float:
    """Cuts are dear, and so are trees with all on one side."""
    cuts = balance = 0
    for fragment in fragments:
        height = fragment.vertices @ normal - offset
        above, below = bool(np.any(height > _ON)), bool(np.any(height < -_ON))
        cuts += above and below
        balance += above - below
    return 8.0 * cuts + abs(balance)


def _half(fragment: Fragment, height: FloatArray) -> Fragment:
    """The part where height (k,) is positive."""
    vertices: list[FloatArray] = []
    edges: list[int] = []
    count = len(height)
    for i in range(count):
        j = (i + 1) % count
        kept, next_kept = height[i] > _ON, height[j] > _ON
        start, stop = fragment.vertices[i], fragment.vertices[j]
        if kept or abs(height[i]) <= _ON:
            vertices.append(start)
            # An edge that leaves at this very vertex becomes the cut.
            edges.append(fragment.edges[i] if kept or next_kept else CUT)
        if (kept and height[j] < -_ON) or (next_kept and height[i] < -_ON):
            share = height[i] / (height[i] - height[j])
            vertices.append(start + share * (stop - start))
            edges.append(CUT if kept else fragment.edges[i])
    return Fragment(fragment.surface, np.array(vertices), tuple(edges))


def _pieces(surfaces: Sequence[Surface]) -> Iterator[Fragment]:
    """All surfaces, cut into small pieces, with what is beyond each edge."""
    sharing: dict[object, list[int]] = {}
    for i, surface in enumerate(surfaces):
        vertices = surface.vertices
        for k in range(4):
            sharing.setdefault(edge_key(vertices[[k, (k + 1) % 4]]), []).append(i)
    for i, surface in enumerate(surfaces):
        vertices = surface.vertices
        beyond = []
        for k in range(4):
            others = [j for j in sharing[edge_key(vertices[[k, (k + 1) % 4]])] if j != i]
            beyond.append(others[0] if others else FREE)
        columns = max(1, round(surface.width / _PIECE))
        rows = max(1, round(surface.height / _PIECE))
        for row in range(rows):
            for column in range(columns):
                steps = _SQUARE + np.array([column, row])
                yield Fragment(
                    i,
                    surface.corner
                    + steps[:, :1] / columns * surface.right
                    + steps[:, 1:] / rows * surface.down,
                    (
                        beyond[0] if row == 0 else CUT,
                        beyond[1] if column == columns - 1 else CUT,
                        beyond[2] if row == rows - 1 else CUT,
                        beyond[3] if column == 0 else CUT,
                    ),
                )
