# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The C++ page, its example, and the CMake package that they are used through."""

import re
from pathlib import Path

import ruledgraph_factors as rf
from cpp import (
    CPP,
    FACTORS,
    build_with_gtsam,
    cmake,
    eigen_folder,
    headers_of,
    run,
    stand_in,
    together_group,
)

EXAMPLE = FACTORS / "examples/line_in_graph.cpp"
CONSUMER = """
cmake_minimum_required(VERSION 3.18...4.0)
project(consumer LANGUAGES NONE)
find_package(ruledgraph REQUIRED COMPONENTS core gtsam)
foreach(target core gtsam)
  get_target_property(headers ruledgraph::${target} INTERFACE_INCLUDE_DIRECTORIES)
  get_target_property(needs ruledgraph::${target} INTERFACE_LINK_LIBRARIES)
  message(NOTICE "${target}: ${headers} ${needs}")
endforeach()
"""


def without_layout(text: str) -> str:
    return " ".join(text.split())


def test_every_block_of_the_page_is_a_part_of_the_example() -> None:
    blocks = re.findall(r"```cpp\n(.*?)```", (FACTORS / "CPP.md").read_text(), re.DOTALL)
    example = without_layout(EXAMPLE.read_text())
    assert len(blocks) >= 7
    for block in blocks:
        assert without_layout(block) in example, block


@together_group
def test_the_examples_compile(together: Path) -> None:
    included = headers_of(CPP / "together.cpp", *stand_in(40300))
    assert {EXAMPLE, EXAMPLE.with_name("vio.cpp")} <= included
    assert together.is_file()


def test_the_example_includes_all_that_it_uses() -> None:
    """Of what comes before it in `together.cpp` nothing but the tests' own headers is new to it."""
    before = headers_of(CPP / "core_test.cpp") - headers_of(EXAMPLE, *stand_in(40300))
    assert {path.parent for path in before} == {CPP}


def consume(folder: Path, package: Path) -> list[str]:
    """What a project learns of the targets of an installed package."""
    folder.mkdir()
    (folder / "CMakeLists.txt").write_text(CONSUMER)
    gtsam = folder / "gtsam"
    gtsam.mkdir()
    (gtsam / "GTSAMConfig.cmake").write_text("add_library(gtsam INTERFACE IMPORTED)\n")
    found = cmake(
        *("-S", folder, "-B", folder / "build", f"-DCMAKE_PREFIX_PATH={package}"),
        *(f"-DGTSAM_DIR={gtsam}", f"-DEigen3_DIR={eigen_folder().parents[1]}/share/eigen3/cmake"),
        *(f"-Druledgraph_DIR={package}",) * (package / "ruledgraphConfig.cmake").is_file(),
    )
    return [line for line in found.splitlines() if line.startswith(("core:", "gtsam:"))]


def test_cmake_finds_the_headers_of_an_installed_prefix(tmp_path: Path) -> None:
    prefix = tmp_path / "prefix"
    cmake("-S", FACTORS, "-B", tmp_path / "build", f"-DCMAKE_INSTALL_PREFIX={prefix}")
    cmake("--install", tmp_path / "build")
    headers = prefix / "include"
    here = {path.relative_to(FACTORS / "include") for path in FACTORS.glob("include/**/*.hpp")}
    assert {path.relative_to(headers) for path in headers.rglob("*.hpp")} == here
    assert (prefix / "share/ruledgraph/examples/line_in_graph.cpp").is_file()
    found = consume(tmp_path / "consumer", prefix)
    assert found == [f"core: {headers} Eigen3::Eigen", f"gtsam: {headers} gtsam"]


def test_cmake_finds_the_headers_of_the_python_package(tmp_path: Path) -> None:
    headers = Path(rf.get_include())
    assert (headers / "ruledgraph/gtsam/ruled_surface_factor.hpp").is_file()
    found = consume(tmp_path / "consumer", Path(rf.get_cmake_dir()))
    assert found == [f"core: {headers} Eigen3::Eigen", f"gtsam: {headers} gtsam"]


def test_the_example_runs_with_a_real_gtsam(tmp_path: Path) -> None:
    program = build_with_gtsam(EXAMPLE.parent, tmp_path) / "line_in_graph"
    distances = [float(number) for number in run(program).split()]
    assert len(distances) == 2
