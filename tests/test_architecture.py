"""The rules that keep the floors apart, read from the sources themselves."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LAYERS = {
    "agfb_cli": {"stages", "figures", "datasets", "case"},
    "stages": {"datasets", "bifurcations", "orbits", "machine", "case"},
    "figures": {"datasets"},
    "datasets": {"case"},
    "bifurcations": {"orbits"},
    "orbits": {"machine", "case"},
    "machine": {"case"},
    "case": set(),
}
# Third-party packages that may appear on some floors only. What is not listed may appear anywhere below
# agfb_cli.
CONFINED = {
    "typer": {"agfb_cli"},
    "rich": set(),
    "packaging": {"agfb_cli"},
    "pydantic": {"case"},
    "pydantic_core": {"case"},
    "tomllib": {"case"},
    "zarr": {"datasets"},
    "numcodecs": {"datasets"},
    "xarray": {"datasets"},
    "dask": {"stages"},
    "distributed": {"stages"},
    "matplotlib": {"figures"},
    "numba": {"machine", "orbits"},
    "pickle": set(),
    "yaml": set(),
    "pandas": set(),
}
# Modules and subpackages of a layer from bottom to top: each imports only what stands before it.
ORDER = {
    "orbits": (
        "system", "solving", "vectors", "steppers", "integration", "period_map", "compiled", "floquet",
        "shooting", "time_steps", "harmonic_balance", "forced_cycle", "grazing", "hopf_start",
        "machine_cycles", "equilibria", "time_runs",
    ),
    "bifurcations": (
        "continuation", "acceptance", "roots", "cycles", "detection", "location", "branch", "arclength",
        "plane", "critical", "normal_forms", "curve", "curves", "curve_continuation", "switching",
        "hopf_point", "tori",
    ),
    "stages": (
        "results", "parameter_columns", "job", "parts", "step_errors", "regularised", "ending", "pass_counts",
        "linear", "cycles", "survey", "certificate", "curves", "plane", "transients", "tori", "refinement",
        "calibration", "reports", "scheduling",
    ),
}  # fmt: skip
TOP_LEVEL_FOLDERS = {"agfb_cli", "pipelines", "configs", "tests"}
MADE_BY_TOOLS = {"build", "dist"}
MUTABLE_CONSTRUCTORS = {"list", "dict", "set", "defaultdict", "deque", "OrderedDict", "Counter", "bytearray"}
MUTATING_METHODS = {
    "append",
    "extend",
    "insert",
    "remove",
    "pop",
    "popitem",
    "clear",
    "update",
    "setdefault",
} | {"add", "discard", "sort", "reverse"}

MODULES = sorted([*(ROOT / "pipelines").rglob("*.py"), *(ROOT / "agfb_cli").rglob("*.py")])
PARSED = {path: ast.parse(path.read_text(encoding="utf-8"), filename=str(path)) for path in MODULES}


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def layer_of(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return "agfb_cli" if parts[0] == "agfb_cli" else parts[1].removesuffix(".py")


def package_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).parent.parts)


def layer_of_import(module: str) -> str | None:
    parts = module.split(".")
    if parts[0] == "agfb_cli":
        return "agfb_cli"
    return parts[1] if parts[0] == "pipelines" and len(parts) > 1 else None


def imported_modules(tree: ast.AST, package: str) -> Iterator[tuple[int, str]]:
    """The absolute name of every module that a module of `package` imports, in function bodies too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = absolute_name(node, package)
            if module == "pipelines":
                yield from ((node.lineno, f"pipelines.{alias.name}") for alias in node.names)
            else:
                yield node.lineno, module


def absolute_name(node: ast.ImportFrom, package: str) -> str:
    """`from ..case import models` in pipelines.machine is pipelines.case."""
    if not node.level:
        return node.module or ""
    above = package.split(".")[: len(package.split(".")) - node.level + 1]
    return ".".join([*above, *([node.module] if node.module else [])])


def forbidden_imports(tree: ast.AST, package: str) -> list[str]:
    """What a module of `package` (pipelines.machine, for instance) imports against the rules."""
    found = []
    layer = layer_of_import(package)
    assert layer is not None
    for line, module in imported_modules(tree, package):
        other = layer_of_import(module)
        library = module.split(".")[0]
        if other is not None and other != layer and other not in LAYERS[layer]:
            found.append(f"line {line}: {layer} imports {module}")
        elif library == "tests" or (library in CONFINED and layer not in CONFINED[library]):
            found.append(f"line {line}: {library} is not for {layer}")
    return found


def dotted_name(path: Path) -> str:
    """`pipelines.case` for its `__init__.py`."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def import_graph(parsed: dict[str, tuple[ast.AST, str]]) -> dict[str, set[str]]:
    """Which modules each module imports, for type checkers only too: `from a import b` may mean module a.b.

    ``parsed``: name of a module -> its source and package.
    """
    graph = {}
    for name, (tree, package) in parsed.items():
        found = {module for _, module in imported_modules(tree, package)}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                found |= {f"{absolute_name(node, package)}.{alias.name}" for alias in node.names}
        graph[name] = found & parsed.keys() - {name}
    return graph


def upward_imports(graph: dict[str, set[str]], layer: str) -> list[str]:
    """Imports of a layer's modules against its order."""
    rank = {name: number for number, name in enumerate(ORDER[layer])}
    inside = {name: name.split(".")[2] for name in graph if name.startswith(f"pipelines.{layer}.")}
    return [
        f"{name} imports {other}"
        for name in inside
        for other in graph[name] & inside.keys()
        if rank[inside[other]] > rank[inside[name]]
    ]


def import_cycle(graph: dict[str, set[str]]) -> tuple[str, ...]:
    """One cycle of imports, or nothing."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return tuple(error.args[1])
    return ()


def calls_of(tree: ast.AST, name: str) -> list[int]:
    calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call))
    return [call.lineno for call in calls if isinstance(call.func, ast.Name) and call.func.id == name]


def mutable_module_names(tree: ast.Module) -> set[str]:
    """Names that a module binds to a list, dictionary or set."""
    names = set()
    for node in tree.body:
        value = node.value if isinstance(node, ast.Assign | ast.AnnAssign) else None
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        literal = isinstance(value, ast.List | ast.Dict | ast.Set | ast.ListComp | ast.DictComp | ast.SetComp)
        constructed = (
            isinstance(value, ast.Call)
            and isinstance(value.func, ast.Name)
            and value.func.id in MUTABLE_CONSTRUCTORS
        )
        if literal or constructed:
            names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return names - {"__all__"}


def mutations(tree: ast.Module) -> list[str]:
    """Where a module changes its own module-level names: the state that no caller can see."""
    shared = mutable_module_names(tree)
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Global):
            found.append(f"line {node.lineno}: global {', '.join(node.names)}")
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            owner = node.func.value
            if isinstance(owner, ast.Name) and owner.id in shared and node.func.attr in MUTATING_METHODS:
                found.append(f"line {node.lineno}: {owner.id}.{node.func.attr}()")
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
            if isinstance(node.ctx, ast.Store | ast.Del) and node.value.id in shared:
                found.append(f"line {node.lineno}: {node.value.id}[...] is assigned")
    return found


def undocumented(tree: ast.Module) -> list[str]:
    """Public functions and classes of a module that have no docstring."""
    public = (node for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef))
    return [node.name for node in public if not node.name.startswith("_") and not ast.get_docstring(node)]


def test_every_floor_has_modules() -> None:
    assert {layer_of(path) for path in MODULES} - {"__init__"} == set(LAYERS)


def test_imports_go_downwards_only() -> None:
    inside = {path: tree for path, tree in PARSED.items() if path.parent != ROOT / "pipelines"}
    found = {name_of(path): forbidden_imports(tree, package_of(path)) for path, tree in inside.items()}
    assert {name: rules for name, rules in found.items() if rules} == {}


def test_no_import_cycles() -> None:
    parsed = {dotted_name(path): (tree, package_of(path)) for path, tree in PARSED.items()}
    graph = import_graph(parsed)
    assert sum(map(len, graph.values())) > 500
    assert import_cycle(graph) == ()


@pytest.mark.parametrize("layer", ORDER)
def test_rooms_of_a_layer_build_on_each_other(layer: str) -> None:
    folder = ROOT / "pipelines" / layer
    found = {path.name.removesuffix(".py") for path in folder.iterdir() if not path.name.startswith("__")}
    assert found == set(ORDER[layer])
    graph = import_graph({dotted_name(path): (tree, package_of(path)) for path, tree in PARSED.items()})
    assert upward_imports(graph, layer) == []


def test_the_order_check_sees() -> None:
    above = {"pipelines.stages.job": {"pipelines.stages.cycles.rows"}, "pipelines.stages.cycles.rows": set()}
    assert upward_imports(above, "stages") == ["pipelines.stages.job imports pipelines.stages.cycles.rows"]


def test_the_package_itself_imports_nothing() -> None:
    top = PARSED[ROOT / "pipelines" / "__init__.py"]
    assert {module for _, module in imported_modules(top, "pipelines")} <= {"__future__"}


def test_nothing_below_the_command_line_prints() -> None:
    found = {
        name_of(path): calls_of(tree, "print")
        for path, tree in PARSED.items()
        if layer_of(path) != "agfb_cli"
    }
    assert {name: lines for name, lines in found.items() if lines} == {}


def test_no_module_changes_its_own_globals() -> None:
    found = {name_of(path): mutations(tree) for path, tree in PARSED.items()}
    assert {name: places for name, places in found.items() if places} == {}


def test_public_names_are_documented() -> None:
    found = {name_of(path): undocumented(tree) for path, tree in PARSED.items()}
    assert {name: names for name, names in found.items() if names} == {}


def test_every_module_says_what_it_is() -> None:
    assert [name_of(path) for path, tree in PARSED.items() if not ast.get_docstring(tree)] == []


def test_every_package_is_a_map_of_its_modules() -> None:
    missing = {}
    for path, tree in PARSED.items():
        if path.name == "__init__.py" and layer_of(path) != "agfb_cli":
            lines = re.findall(r"^- ([\w, ]+):", ast.get_docstring(tree) or "", re.MULTILINE)
            named = {name for line in lines for name in line.split(", ")}
            there = {other.stem for other in path.parent.glob("*.py")} - {"__init__"}
            there |= {other.parent.name for other in path.parent.glob("*/__init__.py")}
            missing[name_of(path)] = sorted(there ^ named)
    assert {name: names for name, names in missing.items() if names} == {}


def test_no_other_top_level_folders() -> None:
    folders = {
        path.name for path in ROOT.iterdir() if path.is_dir() and not path.name.startswith((".", "__"))
    }
    assert folders - MADE_BY_TOOLS == TOP_LEVEL_FOLDERS


@pytest.mark.parametrize(
    ("package", "source"),
    [
        ("pipelines.bifurcations", "from pipelines.machine.film import pressure"),
        ("pipelines.bifurcations", "def f():\n    import pipelines.machine.film"),
        ("pipelines.machine", "from pipelines import orbits"),
        ("pipelines.datasets", "from pipelines.stages.results import Progress"),
        ("pipelines.figures", "import numba"),
        ("pipelines.orbits", "import zarr.storage"),
        ("pipelines.case", "from ..machine import film"),
        ("pipelines.machine", "from .. import stages"),
        ("agfb_cli.commands", "from pipelines.orbits import system"),
    ],
)
def test_the_import_check_sees(package: str, source: str) -> None:
    assert forbidden_imports(ast.parse(source), package) != []


@pytest.mark.parametrize(
    "source",
    [
        "from pipelines.case.scales import Scales",
        "from pipelines.case import scales",
        "def f():\n    import pipelines.case.scales",
        "if TYPE_CHECKING:\n    from .scales import Scales",
    ],
)
def test_the_cycle_check_sees(source: str) -> None:
    case = "pipelines.case"
    scales = (ast.parse("from pipelines.case.models import Case"), case)
    graph = import_graph({f"{case}.scales": scales, f"{case}.models": (ast.parse(source), case)})
    assert set(import_cycle(graph)) == {f"{case}.scales", f"{case}.models"}


def test_the_import_check_lets_neighbours_pass() -> None:
    assert forbidden_imports(ast.parse("from . import film\nfrom .foil import q"), "pipelines.machine") == []


@pytest.mark.parametrize(
    "source",
    [
        "SEEN = []\ndef f(x):\n    SEEN.append(x)",
        "A = {}\ndef f(x):\n    A[x] = 1",
        "def f():\n    global n\n    n = 1",
    ],
)
def test_the_mutation_check_sees(source: str) -> None:
    assert mutations(ast.parse(source)) != []


def test_no_test_is_left_out_where_a_change_lands() -> None:
    """`make test` and `make rest` divide the tests between them; `make check` and `.ci/run` run both."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    chosen = re.findall(r"\$\(PYTEST\) -m '([^']+)'", makefile)
    assert chosen == ["not slow and not reliability", "slow or reliability"]
    assert re.search(r"^check: lint test rest ", makefile, re.MULTILINE)
    lines = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert {"make test", "make rest"} <= set(lines)
    assert not [line for line in lines if "pytest" in line]
