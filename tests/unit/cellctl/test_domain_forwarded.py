from __future__ import annotations

import msgspec
import pytest

from cellctl.domain import cell_path, forwarded
from cellctl.domain.cell_path import CellPath, CellPathError
from cellctl.domain.forwarded import MAX_AGE_S, Word

SECRET, OTHER = b"s" * 32, b"o" * 32
WORD = Word(100.0, "1", "north", "south", "10.0.0.7", "north:8000", "https", "POST", "/api/v1/cell/hold?x=1", "https://south:8001/stop")


def test_word_that_its_sender_signed_is_read_as_it_was_said() -> None:
    header = forwarded.signed(WORD, SECRET)
    assert forwarded.claimed(header) == WORD and forwarded.is_signed(header, SECRET)
    assert header.isascii() and not set(header) & set(" ,;\r\n")


def test_word_changed_by_any_character_or_signed_by_another_is_not_signed() -> None:
    header = forwarded.signed(WORD, SECRET)
    assert not forwarded.is_signed(header, OTHER) and not forwarded.is_signed(header, None)
    lie = forwarded.signed(msgspec.structs.replace(WORD, address="10.0.0.8"), OTHER)
    assert not forwarded.is_signed(f"{lie.partition('.')[0]}.{header.partition('.')[2]}", SECRET)
    for place in range(len(header) - 1):
        other = "A" if header[place] != "A" else "B"
        assert not forwarded.is_signed(header[:place] + other + header[place + 1 :], SECRET) or header[place] == "."


@pytest.mark.parametrize("header", ["", ".", "a.b", "x" * 5000 + ".y", "é.é", "e30.AAAA", "bnVsbA.", "eyJhdCI6MX0.x"])
def test_what_is_no_word_is_none(header: str) -> None:
    assert forwarded.claimed(header) is None
    assert not forwarded.is_signed(header, SECRET)


@pytest.mark.parametrize(
    ("cell", "method", "target", "now", "says"),
    [
        ("south", "POST", WORD.target, 100.0 + MAX_AGE_S, ""),
        ("south", "POST", WORD.target, 101.0 + MAX_AGE_S, "old"),
        ("south", "POST", WORD.target, 99.0 - MAX_AGE_S, "old"),
        ("south", "GET", WORD.target, 100.0, "another request"),
        ("south", "POST", "/api/v1/cell/hold", 100.0, "another request"),
        ("west", "POST", WORD.target, 100.0, "not of south"),
    ],
)
def test_word_counts_for_its_own_request_and_cell_and_a_few_seconds_only(cell: str, method: str, target: str, now: float, says: str) -> None:
    why = forwarded.why_not(WORD, cell, method, target, now)
    assert says in why and bool(why) == bool(says)


@pytest.mark.parametrize(
    ("raw", "cell", "rest"),
    [
        (b"/cells/b/api/v1/cell", "b", "/api/v1/cell"),
        (b"/cells/a%20b/api/v1/parts/", "a b", "/api/v1/parts/"),
        (b"/cells/b/api/v1/materials/316L%2BNb", "b", "/api/v1/materials/316L%2BNb"),
        (b"/cells/b/", "b", "/"),
        (b"/cells/b", "b", ""),
    ],
)
def test_path_of_a_cell_is_parted_in_its_name_and_its_own_path(raw: bytes, cell: str, rest: str) -> None:
    assert cell_path.read(raw) == CellPath(cell, rest)


@pytest.mark.parametrize(
    "rest",
    [
        b"b/../api/v1/cell", b"b/api/v1/../../admin", b"b/api/v1/%2e%2e/x", b"b/api/v1/.%2E/x", b"b/api/v1/./x", b"b//api/v1/cell", b"b/api//v1/cell",
        b"b/api/v1/a%2fb", b"b/api/v1/a%2Fb", b"b/api/v1/a%5cb", b"b/api/v1/a\\b", b"b/api/v1/%00", b"b/api/v1/%0d%0a", b"b/metrics", b"b/healthz",
        b"b/api/v2/cell", b"b/api", b"b/API/v1/cell", b"b/cells/a/api/v1/cell", b"../api/v1/cell", b"%2e%2e/api/v1/cell", b"/api/v1/cell", b"",
        b"b%2fc/api/v1/cell", b"b/api/v1/%", b"b/api/v1/%zz", b"b/api/v1/x y", b"b/api/v1/\xc3\xa9", b"b/http://evil/api/v1/x", b"b/api/v1//",
    ],
)  # fmt: skip
def test_path_that_may_lead_elsewhere_is_no_path_of_a_cell(rest: bytes) -> None:
    with pytest.raises(CellPathError):
        cell_path.read(b"/cells/" + rest)


def test_target_is_passed_on_byte_for_byte_and_bounded() -> None:
    assert cell_path.target_of("/api/v1/jobs", b"state=queued&text=a%20b") == "/api/v1/jobs?state=queued&text=a%20b"
    for query in (b"a b", b"a\r\nX: y", b"\xc3\xa9", b"x" * 3000):
        with pytest.raises(CellPathError):
            cell_path.target_of("/api/v1/jobs", query)


def test_middleware_knows_an_upload_by_its_path_at_the_cells_own_host() -> None:
    assert cell_path.at_own_host("/cells/b/api/v1/uploads/u1") == "/api/v1/uploads/u1"
    assert cell_path.at_own_host("/api/v1/parts") == "/api/v1/parts"
    assert cell_path.at_own_host("/cells/b/") == "/cells/b/"
