# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The `ruledgraph` command. Thin: it parses arguments and calls the package.

Whatever is slow to import is imported where it is used, so that `--help` comes at once.
"""

import os
import sys
from contextlib import suppress
from typing import Any

import click

from ruledgraph.app import exit_codes
from ruledgraph.app.cli.batch import batch
from ruledgraph.app.cli.completion import completion
from ruledgraph.app.cli.evaluate import evaluate
from ruledgraph.app.cli.export import export
from ruledgraph.app.cli.info import info
from ruledgraph.app.cli.live import live
from ruledgraph.app.cli.report import report
from ruledgraph.app.cli.settings import settings
from ruledgraph.app.cli.simulate import simulate
from ruledgraph.app.cli.smooth import smooth
from ruledgraph.core.errors import MachineError, RuledgraphError, machine_error


class _Group(click.Group):
    """Turns the package's errors into one line and exit code 2; keeps the commands' order."""

    def list_commands(self, _: click.Context) -> list[str]:
        return list(self.commands)

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
    # Before numpy is loaded. For matrices so small more threads save no time, and they change the
    # rounding, so that results would depend on the number of cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


# In the order of a workflow, which `--help` keeps.
for command in (
    simulate,
    info,
    smooth,
    live,
    batch,
    evaluate,
    report,
    export,
    settings,
    completion,
):
    main.add_command(command)
