# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph completion`: for the shell."""

import click


@click.command()
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
    command = click.get_current_context().find_root().command
    click.echo(complete(command, {}, "ruledgraph", "_RULEDGRAPH_COMPLETE").source())
