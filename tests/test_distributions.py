# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The two distributions as pip builds them: what they need, what they contain, that they import.

They are built without a compiler here, which is quick; so these tests also show that the packages
work on numpy alone.
"""

import os
import subprocess
import sys
import tarfile
from email import message_from_bytes
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import pytest

from _factors_requirement import Provider

ROOT = Path(__file__).parents[1]
FACTORS = ROOT / "factors"

pytestmark = [
    # All of them use the same few builds.
    pytest.mark.xdist_group("distributions"),
    pytest.mark.skipif(
        not (FACTORS / "pyproject.toml").is_file(), reason="this is not a clone: no factors"
    ),
]


def run(*command: str | Path) -> str:
    environment = dict(os.environ, CXX="/there/is/no/compiler")
    environment.pop("RULEDGRAPH_FACTORS", None)
    result = subprocess.run(
        [sys.executable, *command], capture_output=True, text=True, check=False, env=environment
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def build_wheel(source: Path, into: Path) -> Path:
    run("-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "-w", into, source)
    (wheel,) = into.glob("*.whl")
    return wheel


def build_sdist(source: Path, into: Path) -> Path:
    """The source distribution, unpacked."""
    into.mkdir()
    build = "import os, sys; os.chdir(sys.argv[1]); from scikit_build_core.build import build_sdist"
    run("-c", f"{build}; build_sdist(sys.argv[2])", source, into)
    (archive,) = into.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        tar.extractall(into, filter="data")
    return into / archive.name.removesuffix(".tar.gz")


@pytest.fixture(scope="module")
def factors_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_wheel(FACTORS, tmp_path_factory.mktemp("factors"))


@pytest.fixture(scope="module")
def odometry_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_wheel(ROOT, tmp_path_factory.mktemp("odometry"))


@pytest.fixture(scope="module")
def odometry_sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_sdist(ROOT, tmp_path_factory.mktemp("sdist") / "odometry")


def contents(wheel: Path) -> set[str]:
    return set(ZipFile(wheel).namelist())


def requirements(metadata: bytes) -> list[str]:
    """Without those of extras."""
    found = message_from_bytes(metadata).get_all("Requires-Dist", [])
    return [line for line in found if "extra ==" not in line]


def wheel_requirements(wheel: Path) -> list[str]:
    (name,) = (name for name in contents(wheel) if name.endswith(".dist-info/METADATA"))
    return requirements(ZipFile(wheel).read(name))


def of_factors(lines: list[str]) -> list[str]:
    return [line for line in lines if line.startswith("ruledgraph")]


def test_the_factors_need_gtsam_and_numpy_alone(factors_wheel: Path) -> None:
    names = {line.split(">=")[0] for line in wheel_requirements(factors_wheel)}
    assert names == {"gtsam", "numpy"}


def test_the_factors_run_where_nothing_else_is_installed(
    factors_wheel: Path, tmp_path: Path
) -> None:
    ZipFile(factors_wheel).extractall(tmp_path)
    for package in ("gtsam", "numpy"):
        spec = find_spec(package)
        assert spec is not None
        assert spec.origin is not None
        folder = Path(spec.origin).parent
        # Beside a package of a wheel lie the libraries that it brought.
        for needed in (folder, folder.with_name(f"{package}.libs")):
            if needed.exists():
                (tmp_path / needed.name).symlink_to(needed)
    program = (
        "import sys; sys.path.append(sys.argv[1]); import ruledgraph_factors as rf; "
        "print(rf.active_kernel(), rf.__file__)"
    )
    # Isolated (-I) and without the interpreter's own packages (-S).
    kernel, file = run("-I", "-S", "-c", program, tmp_path).split()
    assert (kernel, Path(file).parent) == ("numpy", tmp_path / "ruledgraph_factors")


def test_each_wheel_holds_its_own_package(factors_wheel: Path, odometry_wheel: Path) -> None:
    for wheel, package in ((factors_wheel, "ruledgraph_factors"), (odometry_wheel, "ruledgraph")):
        files = {name for name in contents(wheel) if ".dist-info/" not in name}
        assert {name.split("/")[0] for name in files} == {package}
        assert f"{package}/py.typed" in files
        in_clone = (ROOT if wheel is odometry_wheel else FACTORS) / package
        modules = {str(path.relative_to(in_clone.parent)) for path in in_clone.rglob("*.py")}
        assert {name for name in files if name.endswith(".py")} == modules
        assert any(name.endswith("/LICENSE") for name in contents(wheel))
    assert not any("/frontend/native/" in name for name in contents(odometry_wheel))


def test_the_wheel_of_the_factors_brings_the_cpp_headers(factors_wheel: Path) -> None:
    package = "ruledgraph_factors"
    headers = {path.relative_to(FACTORS) for path in FACTORS.glob("include/**/*.hpp")}
    files = contents(factors_wheel)
    assert {f"{package}/{header}" for header in headers} <= files
    for file in ("ruledgraphConfig.cmake", "ruledgraphConfigVersion.cmake"):
        assert f"{package}/cmake/{file}" in files
    assert f"{package}/examples/line_in_graph.cpp" in files


def test_a_clone_brings_its_own_factors(odometry_wheel: Path) -> None:
    lines = wheel_requirements(odometry_wheel)
    assert of_factors(lines) == [f"ruledgraph-factors @ {FACTORS.as_uri()}"]
    assert {"click", "evo", "gtsam", "matplotlib"} <= {line.split(">=")[0] for line in lines}


@pytest.mark.parametrize("state", ["wheel", "editable"])
def test_linked_factors_are_required_by_version(
    state: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    provider = Provider()
    provider.build_state(state)
    project = {"version": "1.2.3"}
    monkeypatch.setenv("RULEDGRAPH_FACTORS", "linked")
    linked = provider.dynamic_metadata({}, project)
    assert linked == {"dependencies": ["ruledgraph-factors==1.2.3"]}
    monkeypatch.delenv("RULEDGRAPH_FACTORS")
    copied = provider.dynamic_metadata({}, project)
    assert copied == {"dependencies": [f"ruledgraph-factors @ {FACTORS.as_uri()}"]}


def test_a_source_distribution_takes_the_factors_of_its_version_from_an_index(
    odometry_sdist: Path, tmp_path: Path
) -> None:
    version = odometry_sdist.name.split("-")[1]
    expected = [f"ruledgraph-factors=={version}"]
    assert of_factors(requirements((odometry_sdist / "PKG-INFO").read_bytes())) == expected
    assert of_factors(wheel_requirements(build_wheel(odometry_sdist, tmp_path))) == expected


def test_both_distributions_have_the_same_version(
    factors_wheel: Path, odometry_wheel: Path
) -> None:
    assert factors_wheel.name.split("-")[1] == odometry_wheel.name.split("-")[1]


def test_source_distributions_hold_what_their_kernels_are_built_from(
    odometry_sdist: Path, tmp_path: Path
) -> None:
    kernel = Path("ruledgraph/frontend/native")
    headers = Path("include/ruledgraph")
    factors = build_sdist(FACTORS, tmp_path / "factors")
    for sdist, folder, source in (
        (odometry_sdist, kernel, ROOT / kernel),
        (odometry_sdist, "factors" / headers, FACTORS / headers),
        (factors, headers, FACTORS / headers),
        (factors, Path("src"), FACTORS / "src"),
    ):
        names = {path.name for path in (sdist / folder).iterdir()}
        assert names == {path.name for path in source.iterdir()}
    assert (factors / "LICENSE").read_text() == (ROOT / "LICENSE").read_text()
    assert not (factors / "LICENSE").is_symlink()
