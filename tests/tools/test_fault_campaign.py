# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The campaign's own judgement."""

import gtsam
import numpy as np
import pytest

import fault_campaign
from fault_scenes import NAMES
from ruledgraph.core.estimates import Estimate
from ruledgraph.evaluation.ground_truth import GroundTruth
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


def test_errors_are_compared_with_the_covariance_that_came_with_them():
    def estimate(i, y):
        covariance = np.diag([1e-4] * 3 + [1e-4, 1e-4, 1e-4])
        pose = gtsam.Pose3(gtsam.Rot3(), np.array([5.0 + 0.1 * i, y, 0.0]))
        bias = gtsam.imuBias.ConstantBias()
        parts = (covariance, np.eye(3), np.eye(6))
        return Estimate(i * 10**8, pose, np.zeros(3), bias, parts, 4, "tracking", True)

    stamps = np.arange(10) * 10**8
    positions = np.stack([0.1 * np.arange(10), np.zeros(10), np.zeros(10)], axis=1)
    truth = GroundTruth(stamps, positions, np.tile([0.0, 0.0, 0.0, 1.0], (10, 1)))

    def honesty(far):
        estimates = [estimate(i, far * (i > 4)) for i in range(10)]
        return fault_campaign._honesty([fault_campaign.Segment(estimates, estimates)], truth)

    found = honesty(0.0)
    assert found["worst"] == pytest.approx(0.0, abs=1e-6)
    found = honesty(0.2)
    assert found["worst"] == pytest.approx(200.0)
    assert found["3s"] == pytest.approx(0.2 / 3.0 / np.hypot(0.01, 0.003))
    assert found["unreported"] == found["beyond"] == 0.5


def test_the_cases_have_names_of_their_own(tmp_path):
    keys = [case.key for case, _ in fault_campaign.all_cases(tmp_path, tmp_path, 10.0)]
    assert len(keys) == len(set(keys)) > 80
    assert set(NAMES) <= {key.partition(":")[0] for key in keys}
    shown = fault_campaign.table([{"recording": "simulated", "fault": "none", "failure": "CRASH"}])
    assert "simulated: none" in shown.splitlines()[1]
