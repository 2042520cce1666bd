# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`python -m ruledgraph` is the `ruledgraph` command."""

from ruledgraph.app.cli import main

main()
