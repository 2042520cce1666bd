# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The campaign's own judgement."""

import pytest

import fault_campaign
from fault_scenes import NAMES
from ruledgraph.simulation.write import Files

CLEAN = {"fault": "none", "ate": 1.0}
GOOD = {"fault": "blur", "ate": 5.0, "unreported": 0.0, "beyond": 0.0}


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        (GOOD, "good"),
        (GOOD | {"ate": 50.0}, "worse"),
        (GOOD | {"ate": 50.0, "beyond": 0.5}, "reported"),
        (GOOD | {"ate": 5.0, "beyond": 0.5, "unreported": 0.011}, "UNREPORTED"),
        ({"warnings": {"no start": 3}}, "none"),
        ({"warnings": {}}, "NONE, NOT REPORTED"),
        ({"failure": "HANG"}, "HANG"),
    ],
)
def test_verdicts(row, expected):
    assert fault_campaign.verdict(row, CLEAN) == expected


def test_a_crash_and_a_hang_are_findings(tmp_path):
    for file in Files.beside(tmp_path / "simulated.bag"):
        file.write_text("no such file")
    options = ["--cache", str(tmp_path)]
    found = fault_campaign.guarded("simulated: none", options, 60.0)
    assert found["failure"] == "CRASH"
    assert "simulated.bag" in found["traceback"]
    found = fault_campaign.guarded("simulated: none", options, 0.1)
    assert found["failure"] == "HANG"


def test_the_cases_have_names_of_their_own(tmp_path):
    keys = [case.key for case, _ in fault_campaign.all_cases(tmp_path, tmp_path, 10.0)]
    assert len(keys) == len(set(keys)) > 80
    assert set(NAMES) <= {key.partition(":")[0] for key in keys}
    shown = fault_campaign.table([{"recording": "simulated", "fault": "none", "failure": "CRASH"}])
    assert "simulated: none" in shown.splitlines()[1]
