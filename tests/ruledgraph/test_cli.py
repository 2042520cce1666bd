# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
import platform
import subprocess
import sys
from importlib.metadata import version

from ruledgraph_factors import active_kernel


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "ruledgraph", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
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
