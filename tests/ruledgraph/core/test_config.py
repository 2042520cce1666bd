# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import pytest

from ruledgraph.core.config import Config
from ruledgraph.core.settings import ConfigError, config_text, load_config, settings_table


def test_command_line_before_file_before_default(tmp_path):
    file = tmp_path / "settings.yaml"
    file.write_text("window:\n  lag: 2.5\nimu:\n  spike_rate: 2e-01\nedges:\n  bounded: false\n")
    config = load_config(file, ["window.lag=3e0", "edges.detector=hough"])
    assert config.window.lag == 3.0
    assert config.imu.spike_rate == 0.2
    assert config.edges.bounded is False
    assert config.edges.detector == "hough"
    assert config.window.state_interval == Config().window.state_interval


def test_what_is_written_reads_back(tmp_path):
    config = load_config(None, ["edges.max_lines=12", "edges.bounded=false", "window.lag=1.75"])
    file = tmp_path / "config.yaml"
    file.write_text(config_text(config))
    assert load_config(file) == config


def test_what_is_written_explains_itself():
    text = config_text(load_config(None, ["edges.sigma_px=0.35"]))
    assert "  # Standard deviation of an edge point. " in text
    assert " Default: 1.0 px\n  sigma_px: 0.35\n" in text


def test_every_setting_has_a_default_a_range_and_a_meaning():
    listed = settings_table()
    assert {setting.section for setting in listed} == set(Config.model_fields)
    for setting in listed:
        assert setting.meaning.endswith((".", " ...")), setting
        name = f"{setting.section}.{setting.key}"
        chosen = load_config(None, [f"{name}={setting.default}"])
        assert chosen == Config()
        if " to " in setting.choices:
            ends = [end.replace(",", "") for end in setting.choices.split(" to ")]
            assert float(ends[0]) <= float(setting.default) <= float(ends[1])


def test_a_value_of_the_file_that_is_wrong_is_named_with_the_file(tmp_path):
    file = tmp_path / "settings.yaml"
    file.write_text("window:\n  lag: 100\n")
    with pytest.raises(ConfigError, match=r"settings.yaml: window.lag: must lie in 0.04 to 60 s"):
        load_config(file)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        (
            "window.lagg=2",
            "--set window.lagg: no such setting; there are state_interval, lag, camera_period",
        ),
        (
            "windows.lag=2",
            "--set windows: no such section; there are edges, tracks, lines, map, window",
        ),
        ("window.lag=long", "--set window.lag: 'long' is not a number"),
        ("window.lag=nan", "--set window.lag: must lie in"),
        ("edges.max_lines=2.5", "'2.5' is not a whole number"),
        ("edges.bounded=maybe", "'maybe' is not true or false"),
        ("edges.detector=canny", "'canny' is none of lsd, hough"),
        ("window.lag=0.01", "--set window.lag: must lie in 0.04 to 60 s"),
        ("window.lag=0.7", "window.lag must hold 4 times window.state_interval"),
        ("tracks.min_track_age=4.5", "window.lag must exceed tracks.min_track_age"),
        ("tracks.min_length_px=1", "--set tracks.min_length_px: must lie in 10 to 10,000 px"),
        ("window.updates=-1", "--set window.updates: must lie in 0 to 20"),
        ("window", "--set window: write section.key=value"),
    ],
)
def test_wrong_settings_are_named(setting, message):
    with pytest.raises(ConfigError) as caught:
        load_config(None, [setting])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- 1\n- 2\n", "not a mapping of sections"),
        ("window: 3\n", "window: not a mapping of settings"),
        ("window:\n  lag: [1, 2]\n", "window.lag: a single value is wanted"),
        ("window:\n  lga: 2\n", "window.lga: no such setting"),
    ],
)
def test_wrong_files_are_named(tmp_path, text, message):
    file = tmp_path / "settings.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        load_config(file)
    assert str(file) in str(caught.value)


def test_settings_that_bound_each_other_come_in_any_order():
    settings = ["window.lag=0.6", "window.state_interval=0.1"]
    assert load_config(None, settings) == load_config(None, settings[::-1])
