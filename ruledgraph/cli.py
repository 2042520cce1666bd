# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The `ruledgraph` command. Thin: it parses arguments and calls the package.

Whatever is slow to import is imported where it is used, so that `--help` comes at once.
"""

import platform
from importlib.metadata import version
from typing import Any

import click

from ruledgraph import __version__
from ruledgraph.errors import RuledgraphError


class _Group(click.Group):
    """Turns the package's errors into one line and exit code 2."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except RuledgraphError as error:
            click.echo(f"ruledgraph: {error}", err=True)
            ctx.exit(2)


def _print_version(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if wanted:
        click.echo(
            f"ruledgraph {__version__} (gtsam {version('gtsam')}, numpy {version('numpy')}, "
            f"Python {platform.python_version()})"
        )
        context.exit()


@click.group(cls=_Group, no_args_is_help=True)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Show the versions of ruledgraph, gtsam, numpy and Python.",
)
def main() -> None:
    """Line-based visual-inertial odometry as a GTSAM backend."""
