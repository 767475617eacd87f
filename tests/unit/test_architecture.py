"""The rules of the house: who imports whom, where files are opened, how long a file and a function may be."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("cellctl", "planner", "drivers", "sim", "config")
FILE_LINES_MAX = 400  # above it, a file holds two ideas
FUNCTION_LINES_MAX = 60  # about one screen
WITHOUT_DOCSTRINGS = ("cellctl/store/migrations/",)  # their names say what they change
GENERATED_OR_FOREIGN = ("cellctl/console/web/", "cellctl/console/dist/")
# archive.py opens members of an archive in memory
MAY_OPEN_FILES = ("planner/files/", "planner/files.py", "planner/mesh/load.py", "planner/mesh/archive.py")
OPENING_METHODS = {"open", "read_text", "read_bytes", "write_text", "write_bytes", "touch", "unlink", "mkdir", "tofile"}
OPENING_FUNCTIONS = {"open", "fromfile", "loadtxt", "savetxt", "genfromtxt", "memmap", "savez", "load_mesh"}
# Physics, protocols and rules: time and bytes are handed in.
WITHOUT_CLOCK_OR_WIRE = (
    "planner/",
    "config/",
    "cellctl/domain/",
    "drivers/cnc/protocol.py",
    "drivers/cnc/status.py",
    "drivers/cnc/alarms.py",
    "drivers/modbus/registers.py",
    "sim/cnc/",
    "sim/plant/",
    "sim/process/",
    "sim/world.py",
    "sim/faults.py",
    "sim/dryrun.py",
    "sim/compare.py",
)
CLOCKS_AND_WIRES = {"time", "datetime", "asyncio", "socket", "ssl", "serial", "pymodbus", "pty", "termios", "random"}
EXCUSES = re.compile(r"\b(TODO|FIXME|XXX|HACK|(?i:for now|not implemented|placeholder|simplified version))\b")
CONTRACTS = {
    contract["id"]: contract["name"]
    for contract in tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
}

type_of_function = (ast.FunctionDef, ast.AsyncFunctionDef)


def sources() -> list[str]:
    """Paths, from the root, of all Python files of the five packages."""
    found = (path.relative_to(ROOT).as_posix() for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
    return sorted(path for path in found if not path.startswith(GENERATED_OR_FOREIGN))


@cache
def tree_of(path: str) -> ast.Module:
    return ast.parse((ROOT / path).read_text(encoding="utf-8"), filename=path)


@cache
def contract_report() -> str:
    """What import-linter says about every contract."""
    command = [str(Path(sys.executable).parent / "lint-imports"), "--no-logo", "--no-cache"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env={"COLUMNS": "200"})
    return done.stdout + done.stderr


def public_without_docstring(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and name of each public class, function and method that says nothing about itself."""
    for node in tree.body:
        if isinstance(node, (*type_of_function, ast.ClassDef)) and not node.name.startswith("_"):
            if not ast.get_docstring(node):
                yield node.lineno, node.name
            if isinstance(node, ast.ClassDef):
                for member in node.body:
                    if isinstance(member, type_of_function) and not member.name.startswith("_"):
                        overloads = any("overload" in ast.dump(mark) for mark in member.decorator_list)
                        if not overloads and not ast.get_docstring(member):
                            yield member.lineno, f"{node.name}.{member.name}"


def imported_roots(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and top-level name of everything that a module imports, wherever in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name.split(".")[0]) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.lineno, node.module.split(".")[0]


def file_openings(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and name of each call that opens, reads, writes or makes a file."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        if isinstance(node.func, ast.Name) and node.func.id in OPENING_FUNCTIONS:
            yield node.lineno, node.func.id
        if isinstance(node.func, ast.Attribute) and node.func.attr in OPENING_METHODS | OPENING_FUNCTIONS:
            yield node.lineno, node.func.attr


@pytest.mark.parametrize("name", CONTRACTS.values(), ids=CONTRACTS.keys())
def test_import_contract_is_kept(name: str) -> None:
    report = contract_report()
    assert f"{name} KEPT" in report, report


def test_no_file_holds_more_lines_than_one_idea_needs() -> None:
    counts = {path: (ROOT / path).read_text(encoding="utf-8").count("\n") for path in sources()}
    over = [f"{path}: {n} lines, at most {FILE_LINES_MAX}" for path, n in counts.items() if n > FILE_LINES_MAX]
    assert not over, "\n".join(over)


def test_no_function_is_longer_than_a_screen() -> None:
    over = []
    for path in sources():
        for node in ast.walk(tree_of(path)):
            if isinstance(node, type_of_function):
                length = (node.end_lineno or node.lineno) - node.lineno + 1
                if length > FUNCTION_LINES_MAX:
                    over.append(f"{path}:{node.lineno}: {node.name} has {length} lines, at most {FUNCTION_LINES_MAX}")
    assert not over, "\n".join(over)


def test_every_module_says_in_its_docstring_what_it_is_for() -> None:
    spoken = [path for path in sources() if not path.startswith(WITHOUT_DOCSTRINGS)]
    silent = [path for path in spoken if not ast.get_docstring(tree_of(path))]
    assert not silent, "no module docstring: " + ", ".join(silent)


def test_everything_public_has_a_docstring() -> None:
    silent = [
        f"{path}:{line}: {name} has no docstring"
        for path in sources()
        if not path.startswith(WITHOUT_DOCSTRINGS)
        for line, name in public_without_docstring(tree_of(path))
    ]
    assert not silent, "\n".join(silent)


def test_planner_opens_files_only_where_it_reads_meshes_and_in_its_files_package() -> None:
    openings = [
        f"{path}:{line}: {name}() opens a file; that belongs in planner/files"
        for path in sources()
        if path.startswith("planner/") and not path.startswith(MAY_OPEN_FILES)
        for line, name in file_openings(tree_of(path))
    ]
    assert not openings, "\n".join(openings)


def test_physics_protocols_and_rules_are_handed_time_and_bytes() -> None:
    reaching_out = [
        f"{path}:{line}: imports {name}; time and bytes are handed in here"
        for path in sources()
        if path.startswith(WITHOUT_CLOCK_OR_WIRE)
        for line, name in imported_roots(tree_of(path))
        if name in CLOCKS_AND_WIRES
    ]
    assert not reaching_out, "\n".join(reaching_out)


def test_no_source_excuses_itself() -> None:
    excuses = [
        f"{path}:{number}: {line.strip()}"
        for path in sources()
        for number, line in enumerate((ROOT / path).read_text(encoding="utf-8").splitlines(), 1)
        if EXCUSES.search(line)
    ]
    assert not excuses, "\n".join(excuses)


def test_lock_file_names_no_host_and_hashes_every_package() -> None:
    lock = (ROOT / ".setup" / "requirements.txt").read_text(encoding="utf-8")
    assert "://" not in lock
    unhashed = [block.split()[0] for block in lock.split("\n\n") if "==" in block and "--hash=" not in block]
    assert not unhashed
    pinned = [line for line in lock.splitlines() if line and not line.startswith((" ", "#"))]
    assert all("==" in line and line.endswith("\\") for line in pinned)


def test_lock_file_of_the_console_names_no_host() -> None:
    lock = ROOT / "cellctl" / "console" / "web" / "package-lock.json"
    if not (lock.parent / "package.json").exists():
        pytest.skip("the console has no sources yet")
    assert '"resolved"' not in lock.read_text(encoding="utf-8")
