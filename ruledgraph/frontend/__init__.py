# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Edge points per line per frame: gradient, line detection, ruling-guided search."""
