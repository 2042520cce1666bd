# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
import os
import platform
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import ruledgraph
from ruledgraph.app.cli import main
from ruledgraph.app.remove_existing import remove_existing
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.recording import open_recording, write_recording
from ruledgraph_factors import active_kernel
from small_simulation import small_stream

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


@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_help_says_what_it_is(flag: str) -> None:
    result = run(flag)
    assert (result.returncode, result.stderr) == (0, "")
    assert "Line-based visual-inertial odometry" in result.stdout
    listed = result.stdout.partition("Commands:")[2].split("\n")
    commands = [line.split()[0] for line in listed if line[2:3].isalpha()]
    workflow = ["simulate", "info", "smooth", "live", "batch", "evaluate", "report", "export"]
    assert commands == [*workflow, "settings", "completion"]


def _options() -> list[tuple[str, click.Option]]:
    return [
        (name, option)
        for name, command in main.commands.items()
        for option in command.params
        if isinstance(option, click.Option)
    ]


@pytest.mark.parametrize("option", ["--force", "--format", "--seed", "--json"])
def test_an_option_means_the_same_everywhere(option: str) -> None:
    found = [(o.type.to_info_dict(), o.is_flag) for _, o in _options() if option in o.opts]
    assert all(each == found[0] for each in found)


@pytest.mark.parametrize(("command", "option"), _options(), ids=lambda x: getattr(x, "name", x))
def test_an_options_help_is_a_sentence(command: str, option: click.Option) -> None:  # noqa: ARG001
    assert option.help is not None
    assert option.help[0].isupper()
    assert option.help.endswith(".")


@pytest.mark.parametrize("flag", [[], ["--force"]], ids=["", "force"])
def test_force_alone_writes_over(tmp_path: Path, flag: list[str]) -> None:
    stream, _ = small_stream(duration=1.5)
    write_recording(stream, tmp_path / "small.bag", "rosbag1")
    out = tmp_path / "out"
    (out / "mav0").mkdir(parents=True)
    (out / "mav0" / "old").touch()
    words = ["export", str(tmp_path / "small.bag"), str(out), "--format", "asl", *flag]
    result = CliRunner().invoke(main, words)
    assert (result.exit_code == 0) == bool(flag)
    assert (out / "mav0" / "old").exists() == (not flag)
    # The suffix names the format.
    words = ["export", str(tmp_path / "small.bag"), str(tmp_path / "out.mcap")]
    assert CliRunner().invoke(main, words).exit_code == 0
    assert open_recording(tmp_path / "out.mcap").kind == "mcap"


def test_force_leaves_other_folders_alone(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "one.jpg").touch()
    words = ["simulate", "room", "free", str(tmp_path / "photos"), "--format", "asl", "--force"]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 2
    assert "photos: holds neither a recording nor results" in result.output
    assert (tmp_path / "photos" / "one.jpg").exists()


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


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("4", "4")])
def test_linear_algebra_has_one_thread_unless_more_are_asked_for(
    given: str | None, used: str
) -> None:
    """Results do not depend on the number of cores: numpy reads the variable when it is loaded."""
    code = """
import os, sys, ruledgraph.app.cli
early = "numpy" in sys.modules
sys.argv = ["ruledgraph", "settings", "window"]
try:
    ruledgraph.app.cli.main()
except SystemExit:
    print(early, os.environ["OPENBLAS_NUM_THREADS"])
"""
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    if given is not None:
        environment["OPENBLAS_NUM_THREADS"] = given
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        env=environment,
    )
    assert result.stdout.splitlines()[-1] == f"False {used}"


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


def test_force_leaves_devices_alone(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "run.mcap")
    with pytest.raises(RuledgraphError, match=r"run\.mcap: is no file; --force leaves it alone"):
        remove_existing(tmp_path / "run.mcap")
    assert (tmp_path / "run.mcap").exists()


def test_an_interrupt_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("ruledgraph.app.export_command.open_recording", interrupted)
    result = CliRunner().invoke(main, ["export", "a.bag", "b.mcap"])
    assert result.exit_code == 130
    assert result.output == "ruledgraph: interrupted\n"
