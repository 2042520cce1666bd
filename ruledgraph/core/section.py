# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A section of settings, and what a setting carries: default, range, unit, meaning."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


def number(default: float, unit: str, low: float, high: float) -> Any:
    """A setting from `low` to `high`, both allowed; unit "" for pure numbers and counts."""
    return Field(default, ge=low, le=high, json_schema_extra={"unit": unit})


class Section(BaseModel):
    """Settings of one stage."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )
