# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What the packages import, and when: this keeps the factors embeddable and the command fast."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import pytest

PACKAGES = ["ruledgraph", "ruledgraph_factors"]


def modules_after(statement: str) -> set[str]:
    """Top-level names of all modules that a fresh interpreter has loaded after `statement`."""
    report = "import atexit, sys; atexit.register(lambda: print(*sys.modules, file=sys.stderr))"
    result = subprocess.run(
        [sys.executable, "-c", f"{report}\n{statement}"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    return {name.split(".")[0] for name in result.stderr.split()}


def third_party_modules_after(statement: str) -> set[str]:
    return modules_after(statement) - modules_after("pass") - sys.stdlib_module_names


def sources(package: str) -> list[Path]:
    # In an editable installation files(package) can be two folders in one, hence its origin.
    spec = find_spec(package)
    assert spec is not None
    assert spec.origin is not None
    found = sorted(Path(spec.origin).parent.rglob("*.py"))
    assert found
    return found


def imported_names(node: ast.AST, inside_functions: bool) -> Iterator[str]:
    """Top-level names in the absolute import statements below `node`."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from (alias.name.split(".")[0] for alias in child.names)
        elif isinstance(child, ast.ImportFrom) and child.module and not child.level:
            yield child.module.split(".")[0]
        elif inside_functions or not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from imported_names(child, inside_functions)


def test_importing_the_factors_loads_gtsam_and_numpy_alone() -> None:
    loaded = third_party_modules_after("import ruledgraph_factors")
    assert loaded == {"gtsam", "numpy", "ruledgraph_factors"}


@pytest.mark.parametrize("path", sources("ruledgraph_factors"), ids=lambda path: path.name)
def test_no_function_of_the_factors_imports_anything_else(path: Path) -> None:
    imported = set(imported_names(ast.parse(path.read_text()), inside_functions=True))
    assert imported - sys.stdlib_module_names <= {"gtsam", "numpy", "ruledgraph_factors"}


def test_importing_ruledgraph_loads_nothing_else() -> None:
    assert third_party_modules_after("import ruledgraph") == {"ruledgraph"}


def test_help_loads_click_alone() -> None:
    loaded = third_party_modules_after("from ruledgraph.app.cli import main; main(['--help'])")
    assert loaded == {"click", "ruledgraph"}


@pytest.mark.parametrize("package", PACKAGES)
def test_evo_is_not_imported_with_the_package(package: str) -> None:
    """evo is under the GPLv3: only the functions that evaluate with it may import it."""
    for path in sources(package):
        imported = set(imported_names(ast.parse(path.read_text()), inside_functions=False))
        assert "evo" not in imported, path


@pytest.mark.parametrize("package", PACKAGES)
def test_package_is_marked_as_typed(package: str) -> None:
    assert (files(package) / "py.typed").is_file()
