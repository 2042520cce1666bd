# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import pytest

from ruledgraph.core.config import Config, ConfigError, config_text, load_config


def test_command_line_before_file_before_default(tmp_path):
    file = tmp_path / "settings.yaml"
    file.write_text("window:\n  lag: 2.5\n  robust: 2\nedges:\n  bounded: false\n")
    config = load_config(file, ["window.lag=3e0", "edges.detector=hough"])
    assert config.window.lag == 3.0
    assert config.window.robust == 2.0
    assert config.edges.bounded is False
    assert config.edges.detector == "hough"
    assert config.window.knot_interval == Config().window.knot_interval


def test_what_is_written_reads_back(tmp_path):
    config = load_config(None, ["edges.max_lines=12", "edges.bounded=false", "window.lag=1.75"])
    file = tmp_path / "config.yaml"
    file.write_text(config_text(config))
    assert load_config(file) == config


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("window.lagg=2", "--set no setting window.lagg; there are knot_interval, lag, robust"),
        ("windows.lag=2", "--set no section 'windows'; there are edges, window, start"),
        ("window.lag=long", "--set window.lag: 'long' is not a number"),
        ("window.lag=nan", "--set window.lag: must lie in"),
        ("edges.max_lines=2.5", "'2.5' is not a whole number"),
        ("edges.bounded=maybe", "'maybe' is not true or false"),
        ("edges.detector=canny", "'canny' is none of lsd, hough"),
        ("window.lag=0.01", "--set window.lag: must lie in 0.04 to 60 s"),
        ("window.lag=0.7", "window.lag must hold 4 times window.knot_interval"),
        ("start.window=9", "start.window must not exceed window.lag"),
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
        ("window:\n  lga: 2\n", "no setting window.lga"),
    ],
)
def test_wrong_files_are_named(tmp_path, text, message):
    file = tmp_path / "settings.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        load_config(file)
    assert str(file) in str(caught.value)


def test_settings_that_bound_each_other_come_in_any_order():
    settings = ["window.lag=0.6", "window.knot_interval=0.1", "start.window=0.5"]
    assert load_config(None, settings) == load_config(None, settings[::-1])
