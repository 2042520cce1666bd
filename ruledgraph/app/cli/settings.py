# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph settings`: what can be set, with defaults, units and meaning."""

import click


@click.command(short_help="List the settings.")
@click.argument("section", required=False)
def settings(section: str | None) -> None:
    """List all settings, or those of a SECTION, with default, unit and meaning.

    \b
    Examples:
      ruledgraph settings
      ruledgraph settings window
    """
    from rich.console import Console
    from rich.table import Table

    from ruledgraph.core.settings import ConfigError, settings_table

    listed = settings_table()
    sections = list(dict.fromkeys(setting.section for setting in listed))
    if section is not None and section not in sections:
        raise ConfigError(f"{section}: no such section; there are {', '.join(sections)}")
    listed = [setting for setting in listed if section in (None, setting.section)]
    console = Console()
    if not console.is_terminal:
        # Columns apart by tabs: for grep, cut and the like.
        for setting in listed:
            name = f"{setting.section}.{setting.key}"
            click.echo("\t".join((name, setting.default, setting.unit, setting.meaning)))
        return
    table = Table("section", "key", "default", "unit", "range", "meaning", box=None)
    before = ""
    for name, key, default, unit, choices, meaning in listed:
        table.add_row(name if name != before else "", key, default, unit, choices, meaning)
        before = name
    console.print(table)
