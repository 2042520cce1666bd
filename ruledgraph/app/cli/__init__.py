# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The `ruledgraph` command: a file for each of its commands, and what they share."""

from ruledgraph.app.cli.group import main

__all__ = ["main"]
