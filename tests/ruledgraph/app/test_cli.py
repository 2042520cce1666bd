# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
import os
import platform
import subprocess
import sys
from importlib.metadata import version

import pytest

import ruledgraph
from ruledgraph_factors import active_kernel

SLOW = ("gtsam", "cv2", "numpy", "scipy", "matplotlib", "evo", "rosbags", "rich", "ruamel.yaml")


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "ruledgraph", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env=os.environ | environment,
    )


def test_help_says_what_it_is() -> None:
    result = run("--help")
    assert (result.returncode, result.stderr) == (0, "")
    assert "Line-based visual-inertial odometry" in result.stdout


def test_version_names_what_results_depend_on() -> None:
    result = run("--version")
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == (
        f"ruledgraph {version('ruledgraph')} ({active_kernel()} kernel, "
        f"gtsam {version('gtsam')}, numpy {version('numpy')}, Python {platform.python_version()})\n"
    )


def test_unknown_option_is_a_usage_error() -> None:
    result = run("--no-such-option")
    assert (result.returncode, result.stdout) == (2, "")
    assert "Traceback" not in result.stderr
    errors = [line for line in result.stderr.splitlines() if line.startswith("Error:")]
    assert len(errors) == 1
    assert "--no-such-option" in errors[0]


@pytest.mark.parametrize("arguments", [["smooth", "--help"], ["completion", "bash"]], ids=" ".join)
def test_a_commands_help_and_the_completion_import_nothing_slow(arguments: list[str]) -> None:
    code = f"""
import sys, ruledgraph.app.cli
sys.argv = ["ruledgraph", *{arguments}]
try:
    ruledgraph.app.cli.main()
except SystemExit:
    print(*(m for m in {SLOW} if m in sys.modules), file=sys.stderr)
"""
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert result.stderr.splitlines()[-1] == ""


def test_everything_the_package_offers_is_there_when_asked_for() -> None:
    for name in ruledgraph.__all__:
        assert getattr(ruledgraph, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'odometry_'"):
        ruledgraph.odometry_  # noqa: B018


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_shell_is_told_how_to_complete(shell: str) -> None:
    result = run("completion", shell)
    assert result.returncode == 0
    assert f"_RULEDGRAPH_COMPLETE={shell}_complete" in result.stdout


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("ruledgraph sm", "plain,smooth"),
        ("ruledgraph smooth --gr", "plain,--ground-truth"),
        ("ruledgraph export a b --format mc", "plain,mcap"),
        ("ruledgraph evaluate fli", "file,fli"),
    ],
)
def test_words_are_completed(words: str, expected: str) -> None:
    count = str(len(words.split()) - 1)
    variables = {"_RULEDGRAPH_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": count}
    code = "from ruledgraph.app.cli import main; main(prog_name='ruledgraph')"
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env=os.environ | variables,
    )
    assert expected in result.stdout.splitlines()
