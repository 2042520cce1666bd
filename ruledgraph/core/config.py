# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""All settings, their defaults, and reading them: command line before file before default."""

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.plain_yaml import Node, read_yaml


class ConfigError(RuledgraphError):
    """A setting that does not exist or a value it cannot take."""


@dataclass(frozen=True)
class EdgesConfig:
    """Edge points and lines in the image."""

    detector: Literal["lsd", "hough"] = "lsd"
    """Where new lines come from: OpenCV's line segment detector or the paper's Hough transform."""
    points: Literal["maxima", "sobel"] = "maxima"
    """Edge points: maxima of the slope across a ruling, or the paper's thresholded Sobel pixels."""
    gate: float = 3.0
    """The paper's tau: how far from its predicted ruling a Sobel pixel may lie, px."""
    max_lines: int = 24
    """Lines followed at a time."""
    min_length: float = 40.0
    """Shortest segment that starts a line, px."""
    deviation: float = 0.5
    """Standard deviation of an edge point, px."""
    effective_points: float = 20.0
    """The most points of that deviation a line's edge in one frame counts for."""
    bounded: bool = True
    """Whether a line is searched only where it was seen; the paper's rulings are unbounded."""

    def __post_init__(self) -> None:
        _require(0.5 <= self.gate <= 50.0, "gate: must lie in 0.5 to 50 px")
        _require(2 <= self.max_lines <= 200, "max_lines: must lie in 2 to 200")
        _require(20.0 <= self.min_length < 1e4, "min_length: must lie in 20 to 10,000 px")
        _require(0.01 <= self.deviation <= 20.0, "deviation: must lie in 0.01 to 20 px")
        _require(1.0 <= self.effective_points <= 1e4, "effective_points: must lie in 1 to 10,000")


@dataclass(frozen=True)
class WindowConfig:
    """Knots, lag and loss of the fixed-lag smoother."""

    knot_interval: float = 0.2
    """Time between states, s."""
    lag: float = 1.55
    """s; the paper's 140 frames at 90 fps."""
    robust: float = 1.0
    """Cauchy constant, as an offset of the whole line in px; 0 for a quadratic loss."""
    follow_first: float = 0.15
    """How long a line is followed before it enters the graph, s."""
    updates: int = 1
    """Further iSAM2 updates at most, at knots that are not where the IMU predicted them."""

    def __post_init__(self) -> None:
        _require(0.01 <= self.knot_interval <= 1.0, "knot_interval: must lie in 0.01 to 1 s")
        _require(0.04 <= self.lag <= 60.0, "lag: must lie in 0.04 to 60 s")
        _require(0.0 <= self.robust <= 100.0, "robust: must lie in 0 to 100 px")
        _require(0.0 <= self.follow_first < 60.0, "follow_first: must lie in 0 to 60 s")
        _require(0 <= self.updates <= 20, "updates: must lie in 0 to 20")


@dataclass(frozen=True)
class StartConfig:
    """Start at rest or in motion."""

    window: float = 1.0
    """Length of the first window of a start in motion, s."""
    gyroscope_bias: float = 0.1
    """Standard deviation before the start, rad/s."""
    accelerometer_bias: float = 0.1
    """The same, m/s^2."""

    def __post_init__(self) -> None:
        _require(0.4 <= self.window <= 10.0, "window: must lie in 0.4 to 10 s")
        _require(1e-4 <= self.gyroscope_bias <= 1.0, "gyroscope_bias: must lie in 1e-4 to 1 rad/s")
        _require(
            1e-3 <= self.accelerometer_bias <= 5.0,
            "accelerometer_bias: must lie in 1e-3 to 5 m/s^2",
        )


@dataclass(frozen=True)
class TimeOffsetConfig:
    """The time offset between camera and IMU."""

    estimate: bool = True
    """Whether it is estimated, before the start and while running; otherwise, and where the
    calibration says that it is exact (`timeshift_exact: true`), the calibration's stands."""
    sigma: float = 0.01
    """Standard deviation of the calibration's, s."""
    walk: float = 1e-3
    """How fast it changes: standard deviation after one second, s. Stamps of arrival wander, and a
    camera that exposes by itself moves the middle of its exposures: by 10 ms in 100 s."""

    def __post_init__(self) -> None:
        _require(1e-5 <= self.sigma <= 0.1, "sigma: must lie in 1e-5 to 0.1 s")
        _require(1e-6 <= self.walk <= 0.01, "walk: must lie in 1e-6 to 0.01 s")


@dataclass(frozen=True)
class Config:
    """Everything."""

    edges: EdgesConfig = field(default_factory=EdgesConfig)
    window: WindowConfig = field(default_factory=WindowConfig)
    start: StartConfig = field(default_factory=StartConfig)
    time_offset: TimeOffsetConfig = field(default_factory=TimeOffsetConfig)

    def __post_init__(self) -> None:
        _require(
            4.0 * self.window.knot_interval <= self.window.lag,
            "window.lag must hold 4 times window.knot_interval: change both, or neither",
        )
        _require(
            self.window.follow_first < self.window.lag,
            "window.follow_first must be less than window.lag: change both, or neither",
        )
        _require(
            self.start.window <= self.window.lag,
            "start.window must not exceed window.lag: change both, or neither",
        )


def load_config(path: Path | None = None, settings: Iterable[str] = ()) -> Config:
    """The defaults, changed by a YAML file and then by `section.key=value` settings.

    Raises:
        ConfigError: names the file or setting, and the keys there are.
        YamlError: for a file that is no YAML.
    """
    parts = {name: getattr(Config(), name) for name in _names(Config())}
    if path is not None:
        document = read_yaml(path)
        if not isinstance(document, dict):
            raise ConfigError(f"{path}: not a mapping of sections")
        for section, values in document.items():
            if not isinstance(values, dict):
                raise ConfigError(f"{path}: {section}: not a mapping of settings")
            for key, value in values.items():
                _change(parts, f"{path}: ", section, key, value)
    for setting in settings:
        name, equals, value = setting.partition("=")
        section, dot, key = name.strip().partition(".")
        if not (equals and dot):
            raise ConfigError(f"--set {setting}: write section.key=value, such as window.lag=2")
        _change(parts, "--set ", section, key, value.strip())
    return Config(**parts)


def config_text(config: Config) -> str:
    """The settings as YAML that `load_config` reads back to the same."""
    lines = []
    for section, values in dataclasses.asdict(config).items():
        lines.append(f"{section}:")
        lines += [f"  {key}: {_text(value)}" for key, value in values.items()]
    return "\n".join(lines) + "\n"


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _change(parts: dict[str, Any], where: str, section: str, key: str, value: Node) -> None:
    part = parts.get(section)
    if part is None:
        raise ConfigError(f"{where}no section {section!r}; there are {', '.join(parts)}")
    if key not in _names(part):
        raise ConfigError(f"{where}no setting {section}.{key}; there are {', '.join(_names(part))}")
    converted = _converted(f"{where}{section}.{key}", get_type_hints(type(part))[key], value)
    try:
        parts[section] = dataclasses.replace(part, **{key: converted})
    except ConfigError as error:
        raise ConfigError(f"{where}{section}.{error}") from None


def _names(part: Any) -> list[str]:
    return [f.name for f in dataclasses.fields(part)]


_BOOLEANS: Mapping[str, bool] = {"true": True, "false": False}


def _converted(name: str, kind: Any, value: Node) -> Any:
    if not isinstance(value, str):
        raise ConfigError(f"{name}: a single value is wanted")
    if get_origin(kind) is Literal:
        if value not in get_args(kind):
            raise ConfigError(f"{name}: {value!r} is none of {', '.join(get_args(kind))}")
        return value
    try:
        return _BOOLEANS[value.lower()] if kind is bool else kind(value)
    except (ValueError, KeyError):
        wanted = {bool: "true or false", int: "a whole number"}.get(kind, "a number")
        raise ConfigError(f"{name}: {value!r} is not {wanted}") from None


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ConfigError(message)
