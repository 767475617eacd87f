"""HTML as a tree: text becomes markup nowhere but in `Node`, which escapes all of it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from html import escape

# What HTML may not hold even escaped: controls but tab and line ends, lone surrogates, non-characters.
FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufdd0-\ufdef\ufffe\uffff]")
VOID = frozenset({"br", "hr", "img", "meta"})  # elements without an end tag
NAME = re.compile(r"[A-Za-z][A-Za-z0-9-]*")


@dataclass(frozen=True)
class Node:
    """One element. `str(node)` is its HTML; children that are no nodes are text and escaped, as are the attributes' values."""

    name: str
    attributes: tuple[tuple[str, str], ...]
    children: tuple[Node | str, ...]

    def __str__(self) -> str:
        parts: list[str] = []
        self._write(parts)
        return "".join(parts)

    def _write(self, parts: list[str]) -> None:
        parts.append("<" + self.name)
        parts.extend(f' {name}="{clean(value)}"' for name, value in self.attributes)
        parts.append(">")
        for child in self.children:
            if isinstance(child, Node):
                child._write(parts)
            else:
                parts.append(clean(child))
        if self.name not in VOID:
            parts.append(f"</{self.name}>")


@dataclass(frozen=True)
class StyleSheet(Node):
    """A <style> element: CSS of this package, which HTML takes as it stands. Raises ValueError if it could end the element."""

    def _write(self, parts: list[str]) -> None:
        text = "".join(str(child) for child in self.children)
        if "<" in text:
            raise ValueError("a style sheet must not hold <")
        parts.append(f"<style>{text}</style>")


def clean(text: str) -> str:
    """Text for HTML: escaped, characters that HTML forbids shown as U+FFFD."""
    return escape(FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text))


def tag(name: str, /, *children: Node | str | None, **attributes: str | float | None) -> Node:
    """An element. Children that are None are left out, as are attributes; `class_` is class, `stroke_width` is stroke-width.

    Raises ValueError if a name is no name of HTML.
    """
    pairs = [(key.rstrip("_").replace("_", "-"), value) for key, value in attributes.items() if value is not None]
    for word in (name, *(key for key, _ in pairs)):
        if not NAME.fullmatch(word):
            raise ValueError(f"{word!r} is no name of an element or attribute")
    held = tuple(child for child in children if child is not None)
    return Node(name, tuple((key, value if isinstance(value, str) else f"{value:.6g}") for key, value in pairs), held)


def table(columns: tuple[str, ...], rows: list[tuple[Node | str, ...]], class_: str = "") -> Node:
    """A table with a head; columns whose name starts with # hold figures and stand to the right."""
    sides = ["figure" if name.startswith("#") else None for name in columns]
    head = tag("tr", *(tag("th", name.lstrip("#"), class_=side, scope="col") for name, side in zip(columns, sides, strict=True)))
    body = [tag("tr", *(tag("td", cell, class_=side) for cell, side in zip(row, sides, strict=True))) for row in rows]
    return tag("table", tag("thead", head), tag("tbody", *body), class_=class_ or None)
