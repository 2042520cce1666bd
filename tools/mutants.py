# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the tests notice hand-picked mistakes, each in a copy of the packages: a mutation test.

    python tools/mutants.py --jobs 2
    python tools/mutants.py --only 3 --only 17

The mistakes are in `mutant_list.py`. The tests that should notice one run on a copy with it; they
must first pass on a copy without any. Programs that a test starts still run the original.
"""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import click

from mutant_list import MUTANTS, Mutant
from ruledgraph.app.batch.cluster import in_parallel

_ROOT = Path(__file__).resolve().parents[1]
_LONGEST = 600.0  # s; a mutant that never ends is noticed, too
_FAILED, _PASSED = 1, 0
# An editable installation redirects imports before sys.path is looked at.
_RUN = """
import sys
folder, *arguments = sys.argv[1:]
sys.meta_path = [
    finder for finder in sys.meta_path
    if not {"ruledgraph", "ruledgraph_factors"} & set(getattr(finder, "known_source_files", ()))
]
sys.path.insert(0, folder)
import ruledgraph
import ruledgraph_factors
for package in (ruledgraph, ruledgraph_factors):
    assert package.__file__.startswith(folder), package.__file__
import pytest
sys.exit(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *arguments]))
"""


def copy_packages(folder: Path) -> None:
    """Both packages with their compiled modules, as they are imported now."""
    ignored = shutil.ignore_patterns("__pycache__", "native")
    for package, native in (
        (_ROOT / "ruledgraph", "ruledgraph.frontend._native_frame"),
        (_ROOT / "factors" / "ruledgraph_factors", "ruledgraph_factors._native"),
    ):
        shutil.copytree(package, folder / package.name, ignore=ignored)
        spec = find_spec(native)
        if spec is not None and spec.origin is not None:
            shutil.copy(spec.origin, folder.joinpath(*native.split(".")[:-1]))


def mutate(path: Path, old: str, new: str) -> None:
    """Replace a text that occurs once.

    Raises:
        ClickException: when it does not, as the code has changed.
    """
    text = path.read_text(encoding="utf-8")
    if text.count(old) != 1:
        raise click.ClickException(f"{path.name} holds {text.count(old)} times, not once: {old!r}")
    path.write_text(text.replace(old, new), encoding="utf-8")


def run_tests(tests: Sequence[str], mutant: Mutant | None = None) -> int:
    """Exit code of pytest on a copy of the package."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        copy_packages(Path(folder))
        if mutant is not None:
            mutate(Path(folder) / mutant.file, mutant.old, mutant.new)
        command = [sys.executable, "-B", "-c", _RUN, folder, *tests]
        try:
            result = subprocess.run(  # noqa: S603 - our own interpreter
                command, cwd=_ROOT, capture_output=True, text=True, timeout=_LONGEST, check=False
            )
        except subprocess.TimeoutExpired:
            return _FAILED
    if result.returncode not in (_FAILED, _PASSED):
        raise click.ClickException(f"pytest did not run:\n{result.stdout}{result.stderr}")
    return result.returncode


def is_killed(number: int) -> bool:
    """Whether a test fails with that mutant."""
    return run_tests(MUTANTS[number].tests, MUTANTS[number]) == _FAILED


@click.command(help=__doc__.replace("\n\n    ", "\n\n\b\n    ") if __doc__ else None)
@click.option("--only", multiple=True, type=click.IntRange(0, len(MUTANTS) - 1), help="This one.")
@click.option("--jobs", default=1, type=click.IntRange(1), show_default=True, help="At a time.")
def main(only: tuple[int, ...], jobs: int) -> None:
    """Try the mutants."""
    numbers = list(only) or list(range(len(MUTANTS)))
    tests = sorted({test for number in numbers for test in MUTANTS[number].tests})
    if run_tests(tests) != _PASSED:
        raise click.ClickException("the tests fail without a mutant already")
    count = 0
    for number, killed in in_parallel(is_killed, numbers, workers=jobs):
        mutant, verdict = MUTANTS[number], "killed  " if killed else "SURVIVED"
        click.echo(f"{number:3d} {verdict} {mutant.file}: {mutant.old!r} -> {mutant.new!r}")
        count += killed
    click.echo(f"{count} of {len(numbers)} killed, {count / len(numbers):.0%}")


if __name__ == "__main__":
    main()
