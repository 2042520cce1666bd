# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The `ruledgraph` command. Thin: it parses arguments and calls the package.

Whatever is slow to import is imported where it is used, so that `--help` comes at once.
"""

import platform
from importlib.metadata import version

import click

from ruledgraph import __version__


def _print_version(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if wanted:
        click.echo(
            f"ruledgraph {__version__} (gtsam {version('gtsam')}, numpy {version('numpy')}, "
            f"Python {platform.python_version()})"
        )
        context.exit()


@click.command(no_args_is_help=True)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Show the versions of ruledgraph, gtsam, numpy and Python.",
)
def main() -> None:
    """Line-based visual-inertial odometry as a GTSAM backend.

    There is no subcommand yet. What exists so far is the factors package: see factors/EMBEDDING.md.
    """
