# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The `ruledgraph` command. Thin: it parses arguments and calls the package.

Whatever is slow to import is imported where it is used, so that `--help` comes at once.
"""

import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from ruledgraph.app import exit_codes
from ruledgraph.app.cli_batch import batch
from ruledgraph.app.cli_evaluate import evaluate
from ruledgraph.app.cli_live import live
from ruledgraph.app.cli_simulate import simulate
from ruledgraph.app.cli_smooth import smooth
from ruledgraph.app.options import (
    calibration_options,
    force_option,
    format_option,
    recording_options,
)
from ruledgraph.app.settings_command import settings
from ruledgraph.core.errors import MachineError, RuledgraphError, machine_error


class _Group(click.Group):
    """Turns the package's errors into one line and exit code 2; lists commands by workflow."""

    def list_commands(self, _: click.Context) -> list[str]:
        workflow = ("simulate", "info", "smooth", "live", "batch", "evaluate", "report", "export")
        first = [name for name in workflow if name in self.commands]
        return [*first, *sorted(self.commands.keys() - set(first))]

    def main(self, *args: Any, **extra: Any) -> Any:
        try:
            return super().main(*args, **extra)
        except Exception as error:
            trouble = machine_error(error)
            if trouble is None:
                raise
            _complain(trouble)
            sys.exit(exit_codes.NO_RESOURCES)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except MachineError:
            raise
        except KeyboardInterrupt:
            click.echo("ruledgraph: interrupted", err=True)
            ctx.exit(exit_codes.INTERRUPTED)
        except RuledgraphError as error:
            click.echo(f"ruledgraph: {error}", err=True)
            ctx.exit(exit_codes.BAD_INPUT)


def _complain(error: MachineError) -> None:
    """Say it, and no more: what standard output did not take would be tried again at the end."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    with suppress(OSError):
        click.echo(f"ruledgraph: {error}", err=True)


def _print_version(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if wanted:
        from ruledgraph.core.versions import version_text
        from ruledgraph_factors import FactorError

        try:
            click.echo(version_text())
        except FactorError as error:
            raise click.UsageError(str(error)) from None
        context.exit()


@click.group(
    cls=_Group,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Show the versions of ruledgraph, gtsam, numpy, Python, and the kernel.",
)
def main() -> None:
    """Line-based visual-inertial odometry as a GTSAM backend."""


main.add_command(settings)


@main.command(short_help="Show what a recording holds, and whether it will do.")
@click.argument("recording", type=click.Path(path_type=Path))
@calibration_options
@recording_options
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option(
    "--plots",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Draw timing and IMU into this folder.",
)
def info(recording: Path, **options: Any) -> None:
    """Show what a RECORDING holds, what would be used of it, and whether that will do.

    RECORDING is a ROS 1 bag, a ROS 2 bag's folder, an MCAP file or a EuRoC (ASL) folder. All of
    its stamps are read, so damage and gaps show. With a calibration its figures are looked at, too,
    and whether the images turn as the gyroscope does.

    \b
    Examples:
      ruledgraph info flight.bag --duration 30
      ruledgraph info flight.bag --calibration calib.yaml --plots flight_timing
    """
    from ruledgraph.app.info_command import info_command

    info_command(recording, **options)


@main.command(short_help="Write a recording in another format.")
@click.argument("recording", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@format_option
@force_option
@recording_options
def export(recording: Path, out: Path, kind: Any, force: bool, **choice: Any) -> None:
    """Write the camera and the IMU of a RECORDING to OUT in another format.

    Frames are written grey, 8 bit, without loss; recorded JPEGs are kept as they are. A
    calibration in the recording is kept: as sensor.yaml in an asl folder, as camera_info and
    /tf_static in a bag. A bag has no place for the noise figures of the IMU: they are written to
    a .calib.yaml beside OUT. OUT must not exist unless --force is given.

    \b
    Examples:
      ruledgraph export flight.bag flight.mcap
      ruledgraph export flight.bag flight_euroc --format asl
    """
    from ruledgraph.app.export_command import export_command

    export_command(recording, out, kind=kind, force=force, **choice)


main.add_command(smooth)
main.add_command(live)


@main.command()
@click.argument(
    "runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN [RUN ...]"
)
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    metavar="HTML",
    help="Write this page; by default report.html in RUN, of several runs in the current folder.",
)
@click.option("--force", is_flag=True, help="Overwrite the page.")
@click.option(
    "--ground-truth",
    metavar="FILE|BAG:/TOPIC",
    help="Evaluate all runs against this; by default the page has the errors each run noted.",
)
def report(
    runs: tuple[Path, ...], output: Path | None, force: bool, ground_truth: str | None
) -> None:
    """Put results folders on one HTML page.

    RUN is a results folder of `ruledgraph smooth`. The page holds pictures, the trajectory to turn
    and zoom, errors, status, timings, warnings and settings, of several runs also a table of
    comparison. It is one file that needs no other, and prints.

    \b
    Examples:
      ruledgraph report results/run1
      ruledgraph report results/run1 results/run2 --ground-truth flight.gt.tum --output both.html
    """
    from ruledgraph.evaluation.sources import read_poses
    from ruledgraph.visualization.report import write_report

    if output is None:
        output = (runs[0] if len(runs) == 1 else Path()) / "report.html"
    truth = read_poses(ground_truth) if ground_truth else None
    write_report(runs, output, truth, force=force)
    click.echo(str(output))


main.add_command(simulate)
main.add_command(batch)
main.add_command(evaluate)


@main.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the completion script for a SHELL.

    \b
    Examples:
      eval "$(ruledgraph completion bash)"                      # in ~/.bashrc; zsh likewise
      ruledgraph completion fish > ~/.config/fish/completions/ruledgraph.fish
    """
    from click.shell_completion import get_completion_class

    complete = get_completion_class(shell)
    if complete is None:
        raise click.UsageError(f"this version of click knows no completion for {shell}")
    click.echo(complete(main, {}, "ruledgraph", "_RULEDGRAPH_COMPLETE").source())
