# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The packages of `ruledgraph`: imports go one way, and files and classes stay small."""

import ast
from graphlib import CycleError, TopologicalSorter
from importlib.util import find_spec
from pathlib import Path

import pytest

LAYERS = (
    ("__main__",),
    ("app",),
    # The names that `import ruledgraph` offers.
    ("__init__",),
    ("live", "visualization", "baselines", "diagnostics", "simulation"),
    ("odometry",),
    ("segments",),
    ("initialization",),
    ("stages",),
    ("integrity",),
    ("backend", "evaluation"),
    ("synchronization",),
    ("frontend", "imu", "recording"),
    ("calibration",),
    ("core",),
)
"""From top to bottom. A package may import packages of the layers below its own, no others."""

LONGEST_FILE, LONGEST_CLASS = 350, 200
"""In lines."""

MAX_ATTRIBUTES = 12
"""That the methods of a class set. The fields of a record are a table of their own: not counted."""

Graph = dict[str, set[str]]


def root_folder() -> Path:
    # In an editable installation files() can be two folders in one, hence the origin.
    spec = find_spec("ruledgraph")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent


def modules(root: Path) -> dict[str, ast.Module]:
    """Dotted name -> syntax tree; `.pyi` files stand for compiled modules."""
    found = {}
    for path in sorted([*root.rglob("*.py"), *root.rglob("*.pyi")]):
        parts = (root.name, *path.relative_to(root).with_suffix("").parts)
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def imports(trees: dict[str, ast.Module]) -> Graph:
    """Module -> modules of `trees` that it names in import statements, also for types alone."""
    graph: Graph = {}
    for name, tree in trees.items():
        named: set[str] = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                named.update(alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                assert not node.level, f"{name}, line {node.lineno}: a relative import"
                whole = {alias.name: f"{node.module}.{alias.name}" for alias in node.names}
                named.update(m if m in trees else str(node.module) for m in whole.values())
        graph[name] = (named & set(trees)) - {name}
    return graph


def package(module: str) -> str:
    return module.split(".")[1] if "." in module else "__init__"


def wrong_way(graph: Graph, layers: tuple[tuple[str, ...], ...]) -> list[str]:
    """The imports between packages that do not go down."""
    layer = {name: depth for depth, names in enumerate(layers) for name in names}
    return [
        f"{importer} imports {imported}"
        for importer, names in sorted(graph.items())
        for imported in sorted(names)
        if package(importer) != package(imported)
        and layer[package(importer)] >= layer[package(imported)]
    ]


def circle(graph: Graph) -> list[str]:
    """Modules of which each imports the next, the last being the first again; empty if none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(reversed(error.args[1]))
    return []


TREES = modules(root_folder())
IMPORTS = imports(TREES)


def test_every_room_has_one_layer() -> None:
    named = [name for layer in LAYERS for name in layer]
    assert sorted(named) == sorted({package(module) for module in TREES})


def test_imports_go_down() -> None:
    assert sum(map(len, IMPORTS.values())) > len(IMPORTS)
    assert not wrong_way(IMPORTS, LAYERS)


def test_no_modules_import_each_other() -> None:
    assert not circle(IMPORTS)


@pytest.mark.parametrize(
    "statement",
    [
        "import p.top.a",
        "from p.top.a import thing",
        "from p.top import a",
        "def f():\n    from p.top.a import thing",
        "if TYPE_CHECKING:\n    from p.top.a import thing",
    ],
)
def test_an_upward_import_and_a_circle_are_found(statement: str) -> None:
    sources = {
        "p": "",
        "p.top": "",
        "p.top.a": "from p.low.b import other",
        "p.low": "",
        "p.low.b": statement,
    }
    graph = imports({name: ast.parse(text) for name, text in sources.items()})
    layers = (("__init__",), ("top",), ("low",))
    assert wrong_way(graph, layers) == ["p.low.b imports p.top.a"]
    assert set(circle(graph)) == {"p.low.b", "p.top.a"}


def test_rooms_of_one_layer_do_not_import_each_other() -> None:
    assert wrong_way({"p.one.a": {"p.two.b"}, "p.two.b": set()}, (("one", "two"),)) == [
        "p.one.a imports p.two.b"
    ]


def test_the_root_holds_rooms_and_the_odometry_with_its_stages() -> None:
    files = {path.name for path in root_folder().iterdir() if path.is_file()}
    modules = {name for name in files if name.endswith(".py")}
    assert modules == {"__init__.py", "__main__.py", "odometry.py", "stages.py"}
    assert files - modules == {"GUIDE.md", "py.typed"}


def source_files() -> list[Path]:
    """All files in Python and C++, but for those that a build wrote."""
    root = Path(__file__).parents[1]
    found = [
        path
        for folder in ("ruledgraph", "factors", "tools", "tests")
        for path in (root / folder).rglob("*")
        if path.suffix in (".py", ".pyi", ".cpp", ".hpp", ".h")
    ]
    return [path for path in found if "build" not in path.relative_to(root).parts]


def test_files_are_short() -> None:
    lengths = {
        str(path): len(path.read_text(encoding="utf-8").splitlines()) for path in source_files()
    }
    assert {path.suffix for path in source_files()} >= {".py", ".cpp", ".hpp"}
    assert {path: lines for path, lines in lengths.items() if lines > LONGEST_FILE} == {}


def classes() -> dict[str, ast.ClassDef]:
    """By their dotted names."""
    return {
        f"{module}.{node.name}": node
        for module, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }


def attributes(node: ast.ClassDef) -> set[str]:
    """What the methods of a class set on `self`."""
    return {
        part.attr
        for part in ast.walk(node)
        if isinstance(part, ast.Attribute)
        and isinstance(part.ctx, ast.Store)
        and ast.unparse(part.value) == "self"
    }


def test_classes_are_short() -> None:
    lengths = {name: (node.end_lineno or 0) - node.lineno + 1 for name, node in classes().items()}
    assert {name: lines for name, lines in lengths.items() if lines > LONGEST_CLASS} == {}


def test_classes_have_few_attributes() -> None:
    counts = {name: len(attributes(node)) for name, node in classes().items()}
    assert {name: n for name, n in counts.items() if n > MAX_ATTRIBUTES} == {}
