# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What goes wrong with recordings."""

from ruledgraph.errors import RuledgraphError


class RecordingError(RuledgraphError):
    """A recording that cannot be read, or written, as asked."""
