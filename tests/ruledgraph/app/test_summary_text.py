# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a person reads at the end of a run."""

from pathlib import Path

from ruledgraph.app.summary_text import short_text, summary_text

SUMMARY = {
    "frames": 200,
    "frames_estimated": 180,
    "status": {"tracking": 135, "still": 45},
    "lines": 30,
    "line_sightings": 45,
    "lines_in_view": 9.25,
    "innovations": {"states": 0, "nis_per_dof": None},
    "recoveries": [],
    "recording_s": 10.0,
    "wall_s": 4.0,
    "real_time_factor": 2.5,
}
ACCURACY = {"ate_rmse": 0.0123, "ate_max": 0.05, "path_length": 12.0, "rpe_rmse": 0.004}


def rows(**changes) -> dict[str, str]:
    text = summary_text(SUMMARY | changes, Path("out"))
    return {line[:13].rstrip(): line[13:] for line in text.splitlines()}


def test_shares_are_of_the_right_whole():
    found = rows()
    assert found["Frames"] == "180 of 200 estimated (90.0 %)"
    assert found["Status"] == "tracking 67.5 %, still 22.5 %"
    assert found["Lines"] == "30 in the map, seen 45 times, 9.2 in view on average"
    assert found["Speed"] == "10.0 s of recording in 4.0 s, 2.50 times real time"
    assert found["Next"] == "ruledgraph report out"
    assert "Time offset" not in found
    assert "Readout" not in found
    assert "Extrinsics" not in found
    assert rows(readout_s=0.02)["Readout"] == "20.0 ms of a rolling shutter, as given"
    found = rows(readout_s=0.0251, readout_sigma_s=0.0037)["Readout"]
    assert found == "25.1 ms of a rolling shutter, ± 3.7 ms, found in the images"


def test_how_well_the_noise_figures_fit():
    assert not {"Innovations", "Edges"} & rows().keys()
    assert rows(edge_sigma_px=1.46)["Edges"].startswith("1.5 px of noise (median)")
    assert rows(innovations={"states": 90, "nis_per_dof": 3.82})["Innovations"] == (
        "NIS 3.8 per degree of freedom, 1 where the noise figures are right; over 90 states"
    )


def test_errors_offset_and_recoveries_where_there_are_some():
    offset = {"s": -0.00151, "sigma_s": 0.0001, "estimated": True, "given_s": 0.002}
    found = rows(
        accuracy={"trajectory": ACCURACY, "trajectory_live": {"error": "no overlap"}},
        time_offset=offset,
        recoveries=["once"],
    )
    assert found["ATE smoothed"] == (
        "12.3 mm RMSE, 50.0 mm at most, over 12.0 m; drift 4.0 mm per metre (RPE)"
    )
    assert found["ATE live"] == "no overlap"
    assert found["Time offset"] == "t_imu - t_cam = -1.51 ± 0.10 ms, estimated; +2.0 ms as given"
    assert found["Lines"].endswith("; smoother rebuilt once")
    assert rows(recoveries=["at 1 s", "at 2 s"])["Lines"].endswith("; smoother rebuilt 2 times")
    assert rows(time_offset=offset | {"estimated": False})["Time offset"] == (
        "+2.0 ms as given, not estimated"
    )


def test_what_was_found_of_the_extrinsics():
    found = {
        "estimated": True,
        "rotation_deg": 0.912,
        "sigma_rotation_deg": 0.061,
        "translation_m": 0.0021,
        "sigma_translation_m": 0.0009,
    }
    assert rows(extrinsics=found)["Extrinsics"] == (
        "camera turned by 0.91 ± 0.06 deg, moved by 2.1 ± 0.9 mm from the calibration's, estimated"
    )
    assert rows(extrinsics={"estimated": False})["Extrinsics"] == "as given, not estimated"


def test_what_was_found_of_the_focal_length():
    found = {"estimated": True, "ratio": 0.9712, "sigma_ratio": 0.0013}
    assert rows(focal_length=found)["Focal length"] == (
        "-2.88 ± 0.13 % from the calibration's, estimated"
    )
    assert rows(focal_length={"estimated": False})["Focal length"] == "as given, not estimated"


def test_a_run_that_never_started():
    found = rows(frames_estimated=0, status={}, recording_s=0.0, frames=0)
    assert found["Frames"] == "0 of 0 estimated"
    assert "Next" not in found
    assert "Status" not in found


def test_a_run_that_never_started_has_estimated_nothing():
    offset = {"s": 0.002, "sigma_s": 0.01, "estimated": True, "given_s": 0.002}
    turned = dict.fromkeys(("rotation_deg", "translation_m"), 0.0) | {"estimated": True}
    none = {"frames_estimated": 0, "status": {}, "extrinsics": turned, "edge_sigma_px": 1.0}
    found = rows(time_offset=offset, **none)
    assert found["Time offset"] == "+2.0 ms as given"
    assert not {"Extrinsics", "Edges"} & found.keys()
    # What images and gyroscope have shown needs no start.
    found = rows(time_offset=offset | {"s": 0.03, "sigma_s": 0.001}, **none)
    assert found["Time offset"] == "t_imu - t_cam = +30.00 ± 1.00 ms, estimated; +2.0 ms as given"


def test_names_with_spaces_can_be_pasted():
    text = summary_text(SUMMARY, Path("my run"), rerun=Path("a b.rrd"))
    assert "ruledgraph report 'my run'" in text
    assert "rerun 'a b.rrd'" in text


def test_a_few_words():
    assert short_text(SUMMARY) == "180 of 200 frames estimated"
    accuracy = {"trajectory": ACCURACY, "trajectory_live": {"error": "no overlap"}}
    assert short_text(SUMMARY | {"accuracy": accuracy}) == (
        "180 of 200 frames estimated, ATE smoothed 12.3 mm"
    )
