"""Writes every part as DIR/<name>.stl with DIR/<name>.toml beside it: `python -m tests.parts DIR [SEGMENTS] [NAME ...]`."""

from __future__ import annotations

import sys
from pathlib import Path

from planner.files.model_file import stl_bytes
from planner.pipeline import recipe_text
from tests.parts.catalogue import PARTS, SEGMENTS


def main(words: list[str]) -> int:
    """Write the parts asked for, all if none is named; exit 2 with one line for words that mean nothing."""
    numbers = [word for word in words[1:] if word.isdigit()]
    names = [word for word in words[1:] if not word.isdigit()] or list(PARTS)
    unknown = [name for name in names if name not in PARTS]
    if not words or unknown or len(numbers) > 1:
        asked = f"no part {', '.join(unknown)}; there are {', '.join(PARTS)}" if unknown else "python -m tests.parts DIR [SEGMENTS] [NAME ...]"
        print(asked, file=sys.stderr)
        return 2
    folder, segments = Path(words[0]), int(numbers[0]) if numbers else SEGMENTS
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        mesh = PARTS[name].mesh(segments)
        (folder / f"{name}.stl").write_bytes(stl_bytes(mesh))
        (folder / f"{name}.toml").write_text(f"# {PARTS[name].shows}\n{recipe_text(PARTS[name].recipe)}", encoding="utf-8")
        print(f"{name}: {len(mesh.facets)} facets, {mesh.volume:.1f} mm3")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
