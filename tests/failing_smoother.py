# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A smoother that fails when it is told to."""

from typing import Any

import pytest

from ruledgraph.backend.fixed_lag_smoother import FixedLagSmoother, SmootherError


def fail_updates(monkeypatch: pytest.MonkeyPatch, *numbers: int) -> None:
    """Let these updates, counted from 1, fail as an indeterminate system does."""
    update, calls = FixedLagSmoother.update, []

    def sometimes(self: FixedLagSmoother, *arguments: Any) -> Any:
        calls.append(1)
        if len(calls) in numbers:
            raise SmootherError("Indeterminate linear system detected")
        return update(self, *arguments)

    monkeypatch.setattr(FixedLagSmoother, "update", sometimes)
