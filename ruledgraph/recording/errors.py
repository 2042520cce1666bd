# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What goes wrong with recordings."""

from ruledgraph.core.errors import RuledgraphError


class RecordingError(RuledgraphError):
    """A recording that cannot be read, or written, as asked; one line, whatever it quotes."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))
