# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Reading and writing settings: command line before file before default; a list of all."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ruledgraph.core.config import Config
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.plain_yaml import Node, read_yaml


class ConfigError(RuledgraphError):
    """A setting that does not exist or a value it cannot take."""


class Setting(NamedTuple):
    """One setting, as text."""

    section: str
    key: str
    default: str
    unit: str
    """Empty for pure numbers, counts, names and switches."""
    choices: str
    """The values it can take: a range or names."""
    meaning: str


def load_config(path: Path | None = None, settings: Iterable[str] = ()) -> Config:
    """The defaults, changed by a YAML file and then by `section.key=value` settings.

    Raises:
        ConfigError: names the file or setting, and the keys there are.
        YamlError: for a file that is no YAML.
    """
    chosen: dict[str, dict[str, str]] = {}
    origins: dict[tuple[str, str], str] = {}
    for origin, section, key, value in (*_in_file(path), *_on_command_line(settings)):
        _require_known(origin, section, key)
        if not isinstance(value, str):
            raise ConfigError(f"{origin}{section}.{key}: a single value is wanted")
        chosen.setdefault(section, {})[key] = value
        origins[section, key] = origin
    try:
        return Config.model_validate(chosen)
    except ValidationError as error:
        raise ConfigError(_message(error.errors()[0], origins)) from None


def config_text(config: Config) -> str:
    """The settings as YAML that `load_config` reads back to the same, explained by comments."""
    sections: dict[str, list[str]] = {}
    for setting in settings_table():
        value = _text(getattr(getattr(config, setting.section), setting.key))
        # A comment may not end in a blank; the unit stands with the default.
        default = " ".join(filter(None, [setting.default, setting.unit]))
        sections.setdefault(setting.section, []).extend(
            [f"  # {setting.meaning} Default: {default}", f"  {setting.key}: {value}"]
        )
    return "\n".join("\n".join([f"{name}:", *lines, ""]) for name, lines in sections.items())


def settings_table() -> list[Setting]:
    """All settings there are, section by section."""
    return [
        Setting(
            section,
            key,
            _text(field.default),
            _unit(field),
            _choices(field),
            " ".join((field.description or "").split()),
        )
        for section, part in Config()
        for key, field in type(part).model_fields.items()
    ]


_Found = tuple[str, str, str, Node]
"""Where it was found, section, key, value."""


def _in_file(path: Path | None) -> Iterator[_Found]:
    document = {} if path is None else read_yaml(path)
    if not isinstance(document, dict):
        raise ConfigError(f"{path}: not a mapping of sections")
    for section, values in document.items():
        if not isinstance(values, dict):
            raise ConfigError(f"{path}: {section}: not a mapping of settings")
        for key, value in values.items():
            yield f"{path}: ", section, key, value


def _on_command_line(settings: Iterable[str]) -> Iterator[_Found]:
    for setting in settings:
        name, equals, value = setting.partition("=")
        section, dot, key = name.strip().partition(".")
        if not (equals and dot):
            raise ConfigError(f"--set {setting}: write section.key=value, such as window.lag=2")
        yield "--set ", section, key, value.strip()


def _require_known(origin: str, section: str, key: str) -> None:
    sections = Config.model_fields
    if section not in sections:
        raise ConfigError(f"{origin}{section}: no such section; there are {', '.join(sections)}")
    keys = _fields(section)
    if key not in keys:
        raise ConfigError(f"{origin}{section}.{key}: no such setting; there are {', '.join(keys)}")


def _fields(section: str) -> dict[str, FieldInfo]:
    return type(getattr(Config(), section)).model_fields  # type: ignore[no-any-return]


def _message(error: ErrorDetails, origins: dict[tuple[str, str], str]) -> str:
    """What is wrong, in one line."""
    if len(error["loc"]) != 2:
        return error["msg"].removeprefix("Value error, ")
    section, key = map(str, error["loc"])
    name = f"{origins[section, key]}{section}.{key}"
    field, kind = _fields(section)[key], error["type"]
    if get_origin(field.annotation) is Literal:
        return f"{name}: {error['input']!r} is none of {_choices(field)}"
    if kind in ("greater_than_equal", "less_than_equal", "finite_number"):
        return f"{name}: must lie in {' '.join(filter(None, [_choices(field), _unit(field)]))}"
    return f"{name}: {error['input']!r} is not {_WANTED.get(field.annotation, 'a number')}"


_WANTED: dict[Any, str] = {bool: "true or false", int: "a whole number"}


def _unit(field: FieldInfo) -> str:
    extra = field.json_schema_extra
    return str(extra["unit"]) if isinstance(extra, dict) else ""


def _choices(field: FieldInfo) -> str:
    if get_origin(field.annotation) is Literal:
        return ", ".join(get_args(field.annotation))
    if field.annotation is bool:
        return "true, false"
    low, high = (
        next(getattr(limit, name) for limit in field.metadata if hasattr(limit, name))
        for name in ("ge", "le")
    )
    return f"{_short(low)} to {_short(high)}"


def _short(value: float) -> str:
    return f"{value:,g}" if value < 1e6 else f"{value:g}"


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
