# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

from click.testing import CliRunner

from ruledgraph.app.cli import main
from ruledgraph.core.config import Config


def settings(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(main, ["settings", *arguments])
    return result.exit_code, result.output


def test_all_settings_are_listed_one_a_line():
    code, output = settings()
    names = [line.split("\t")[0] for line in output.splitlines()]
    assert code == 0
    assert names == [f"{name}.{key}" for name, part in Config() for key, _ in part]
    assert "edges.sigma_px\t1.0\tpx\tStandard deviation of an edge point." in output


def test_a_section_alone_is_listed():
    code, output = settings("start")
    assert code == 0
    assert len(output.splitlines()) == len(type(Config().start).model_fields)


def test_an_unknown_section_is_named_with_those_there_are():
    code, output = settings("windows")
    assert code == 2
    assert "windows: no such section; there are edges, tracks" in output
