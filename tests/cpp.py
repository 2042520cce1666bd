# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""C++ test programs: built, run with numbers on standard input, read back as numbers."""

import os
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import distribution
from pathlib import Path

import gtsam
import numpy as np
import pytest

from ruledgraph_factors import get_cmake_dir

FACTORS = Path(__file__).resolve().parents[1] / "factors"
CPP = Path(__file__).resolve().with_name("factors") / "cpp"

_COMPILERS = (os.environ.get("CXX"), "c++", "g++", "clang++")
# Without optimisation: that is quicker here, and rounding is that of the source.
_FLAGS = ("-std=c++17", "-O0", "-Wall", "-Wextra", "-Wpedantic", "-Werror")


def eigen_folder() -> Path:
    return Path(str(distribution("cmeel-eigen").locate_file("cmeel.prefix/include/eigen3")))


def stand_in(version: int) -> list[str]:
    """Flags that put the stand-in for this version of GTSAM (40200, 40300) in its place."""
    return [f"-DSTANDIN_VERSION={version}", "-isystem", str(CPP / "standin")]


# One worker compiles it, for all tests that run it.
together_group = pytest.mark.xdist_group("C++ together")


def compile_cpp(source: Path, *flags: str) -> str:
    """What the compiler writes to standard output."""
    compiler = next((path for path in map(shutil.which, filter(None, _COMPILERS)) if path), None)
    if compiler is None:
        pytest.skip("there is no C++ compiler")
    includes = ["-I", str(FACTORS / "include"), "-I", str(CPP), "-isystem", str(eigen_folder())]
    built = subprocess.run(
        [compiler, *_FLAGS, *includes, str(source), *flags],
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    return built.stdout


def headers_of(source: Path, *flags: str) -> set[Path]:
    """All that it includes, by whatever way."""
    rule = compile_cpp(source, *flags, "-M").replace("\\\n", " ")
    return {Path(name).resolve() for name in rule.split()[2:]}


def build(source: Path, into: Path, *flags: str) -> Path:
    """The program."""
    program = into / source.stem
    compile_cpp(source, *flags, "-o", str(program))
    return program


def cmake(*arguments: str | Path) -> str:
    """What cmake says besides its progress."""
    command = shutil.which("cmake")
    if command is None:
        pytest.skip("there is no cmake")
    result = subprocess.run([command, *arguments], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stderr


def build_with_gtsam(project: Path, into: Path) -> Path:
    """The folder with the programs of a CMake project, built with a real GTSAM."""
    if not (os.environ.get("GTSAM_DIR") or os.environ.get("CMAKE_PREFIX_PATH")):
        pytest.skip("neither GTSAM_DIR nor CMAKE_PREFIX_PATH says where a GTSAM for C++ is")
    package = f"-Druledgraph_DIR={get_cmake_dir()}"
    cmake("-S", project, "-B", into / "build", package, "-DCMAKE_BUILD_TYPE=Release")
    cmake("--build", into / "build")
    return into / "build"


def run(program: Path, *arguments: str, text: str = "") -> str:
    """What a program writes when it reads `text`."""
    result = subprocess.run(
        [program, *arguments], input=text, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


def numbers_of(parts: Sequence[object]) -> str:
    """Numbers, arrays row by row, poses as rotation and translation; without loss."""
    return " ".join(_words(parts))


def _words(parts: Iterable[object]) -> Iterator[str]:
    for part in parts:
        if isinstance(part, gtsam.Pose3):
            yield from _words([part.rotation().matrix(), part.translation()])
        else:
            yield from (float(number).__repr__() for number in np.ravel(np.asarray(part)))


class Reader:
    """Takes numbers from the front of a program's output."""

    def __init__(self, output: str) -> None:
        self._numbers = np.array(output.split(), dtype=float)
        self._next = 0

    def take(self, count: int) -> np.ndarray:
        taken = self._numbers[self._next : self._next + count]
        assert taken.size == count, "the program wrote too few numbers"
        self._next += count
        return taken

    @property
    def at_end(self) -> bool:
        return self._next == self._numbers.size
