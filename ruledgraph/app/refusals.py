# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Measurements of a live sensor that cannot be used: a run goes on without them."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import click

from ruledgraph.core.errors import MeasurementError, RuledgraphError

# Without any that can be used for so long a run is of no use, s.
_LONGEST = 3.0


class Refusals:
    """Counts the refused measurements of one sensor, and warns of the first.

    Args:
        what: a measurement is called, "image".
    """

    def __init__(self, what: str) -> None:
        self.count = 0
        self._what = what
        self._since: float | None = None

    @contextmanager
    def counted(self) -> Iterator[None]:
        """Around the use of one measurement.

        Raises:
            RuledgraphError: when for seconds all were refused.
        """
        try:
            yield
        except MeasurementError as error:
            self._refuse(error)
        else:
            self._since = None

    def _refuse(self, error: MeasurementError) -> None:
        if not self.count:
            click.echo(f"warning: an {self._what} is left out: {error}", err=True)
        self.count += 1
        now = time.monotonic()
        self._since = now if self._since is None else self._since
        if now - self._since >= _LONGEST:
            raise RuledgraphError(f"no {self._what} for {_LONGEST:g} s could be used: {error}")

    def __str__(self) -> str:
        return f"{self.count} {self._what}{'' if self.count == 1 else 's'}"
