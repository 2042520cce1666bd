# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Reads YAML as nested dicts and lists of strings; whoever asks for a number converts it.

So `2e-05` is no string by accident, tags such as `!!opencv-matrix` need no class, and nothing in
a file can run code, nest without end or grow by aliases.
"""

import re
from pathlib import Path
from typing import Any, TypeAlias

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from ruledgraph.core.errors import RuledgraphError

Node: TypeAlias = "str | list[Node] | dict[str, Node]"

_LARGEST_FILE = 100_000  # bytes; calibrations have a few thousand
_DEEPEST = 16
# OpenCV writes `%YAML:1.0`, which is no directive of YAML.
_HEADER = re.compile(r"\A\ufeff?%YAML[^\n]*")


class YamlError(RuledgraphError):
    """A file that cannot be read, is no YAML, or uses more of it than calibrations do."""


def read_yaml(path: Path, largest: int = _LARGEST_FILE) -> Node:
    """The file's first document.

    Args:
        path: of the file.
        largest: its size, bytes; more is refused.

    Raises:
        YamlError: one line that names the file and, where it can, the line in it.
    """
    try:
        with path.open("rb") as file:
            data = file.read(largest + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise YamlError(f"{path}: cannot be read: {reason}") from None
    if len(data) > largest:
        raise YamlError(
            f"{path}: larger than {largest // 1000} kB, not a calibration or configuration"
        )
    try:
        return _first_document(_HEADER.sub("", data.decode()))
    except UnicodeDecodeError:
        raise YamlError(f"{path}: not a text file") from None
    except MarkedYAMLError as error:
        line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
        raise YamlError(f"{path}{line}: not valid YAML: {error.problem}") from None
    # The parser answers some malformed directives with these.
    except (YAMLError, AssertionError, LookupError, TypeError, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise YamlError(f"{path}: not plain YAML: {reason}") from None


def _first_document(text: str) -> Node:
    """Build the nodes from the parser's events, without recursion."""
    document: list[Node] = []
    # The collections that are open, and for a dict the key whose value comes next.
    stack: list[tuple[Any, str | None]] = [(document, None)]
    for event in YAML(typ="safe", pure=True).parse(text):
        kind = type(event).__name__
        if kind == "AliasEvent":
            raise YAMLError("aliases (*name) are not supported, write the value out")
        if kind in ("MappingEndEvent", "SequenceEndEvent"):
            stack.pop()
        elif kind in ("ScalarEvent", "MappingStartEvent", "SequenceStartEvent"):
            node: Node = event.value if kind == "ScalarEvent" else {} if kind[0] == "M" else []
            _add(stack, node)
            if not isinstance(node, str):
                stack.append((node, None))
            if len(stack) > _DEEPEST:
                raise YAMLError(f"nested deeper than {_DEEPEST} levels")
        elif kind == "DocumentEndEvent":
            break
    return document[0] if document else ""


def _add(stack: list[tuple[Any, str | None]], node: Node) -> None:
    parent, key = stack[-1]
    if isinstance(parent, list):
        parent.append(node)
    elif key is not None:
        parent[key] = node
        stack[-1] = (parent, None)
    elif not isinstance(node, str):
        raise YAMLError("a key is not a word")
    elif node in parent:
        raise YAMLError(f"the key {node[:40]!r} occurs twice")
    else:
        stack[-1] = (parent, node)
