# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The C++ headers compile and work without Python: their own test program, built and run."""

import os
import shutil
import subprocess
from importlib.metadata import distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_headers_pass_their_own_test_program(tmp_path: Path) -> None:
    compilers = (os.environ.get("CXX"), "c++", "g++", "clang++")
    compiler = next((path for path in map(shutil.which, filter(None, compilers)) if path), None)
    if compiler is None:
        pytest.skip("there is no C++ compiler")
    eigen = Path(str(distribution("cmeel-eigen").locate_file("cmeel.prefix/include/eigen3")))
    program = tmp_path / "ruled_surface_test"
    warnings = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    includes = ["-I", str(ROOT / "factors/include"), "-isystem", str(eigen)]
    source = Path(__file__).with_name("ruled_surface_test.cpp")
    built = subprocess.run(
        [compiler, "-std=c++17", "-O1", *warnings, *includes, str(source), "-o", str(program)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    result = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout) == (0, "passed\n"), result.stderr
