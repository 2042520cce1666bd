# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a run that yielded little may come from: the checks of `ruledgraph info`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.diagnostics.info import inspect_recording

_MAX_CAUSES = 4


def likely_causes(
    recording: Path, calibration: Calibration, config: Config, choice: Mapping[str, Any]
) -> list[str]:
    """The most telling of what is wrong with a recording and its calibration, likeliest first.

    Args:
        recording: its path.
        calibration: that was used.
        config: the settings that were used.
        choice: topics and stretch, as for `inspect_recording`.
    """
    try:
        info = inspect_recording(
            recording, calibrate=lambda *_: calibration, config=config, **choice
        )
    except RuledgraphError as error:
        return [str(error)]
    # Mounting and clock are looked at last and explain most, then the calibration's figures.
    wrong = [finding.text for finding in reversed(info.findings) if not finding.good]
    return [*info.missing, *info.unit_warnings, *wrong][:_MAX_CAUSES]
