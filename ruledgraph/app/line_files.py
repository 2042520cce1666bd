# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines as 3-D models, for viewers such as MeshLab, CloudCompare and Blender."""

from pathlib import Path

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.text_file import write_whole


def write_ply(path: Path, ends: FloatArray) -> None:
    """Write line segments (L, 2, 3), m, as the edges of a PLY file."""
    header = [
        "ply",
        "format ascii 1.0",
        f"element vertex {2 * len(ends)}",
        *(f"property double {axis}" for axis in "xyz"),
        f"element edge {len(ends)}",
        "property int vertex1",
        "property int vertex2",
        "end_header",
    ]
    edges = [f"{2 * i} {2 * i + 1}" for i in range(len(ends))]
    write_whole(path, "\n".join([*header, *_vertices(ends), *edges]) + "\n")


def write_obj(path: Path, ends: FloatArray) -> None:
    """Write line segments (L, 2, 3), m, as the lines of a Wavefront OBJ file."""
    vertices = [f"v {vertex}" for vertex in _vertices(ends)]
    lines = [f"l {2 * i + 1} {2 * i + 2}" for i in range(len(ends))]
    write_whole(path, "\n".join([*vertices, *lines, ""]))


def _vertices(ends: FloatArray) -> list[str]:
    return [" ".join(f"{x:.9g}" for x in vertex) for vertex in ends.reshape(-1, 3)]
