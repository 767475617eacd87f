"""SHDR, the adapter's lines to an MTConnect agent: what was observed as text, and the heartbeat. No wire here.

Source: MTConnect Agent adapter protocol, version 2: `time|key|value`, conditions `time|key|level|code|severity|qualifier|text`,
assets `time|@ASSET@|id|type|--multiline--TAG`, and `* PING` answered by `* PONG milliseconds`.
"""

from __future__ import annotations

from datetime import UTC, datetime

from cellctl.shop.mtconnect_words import Active, Value

HEARTBEAT_MS = 10_000  # an agent that hears nothing for twice as long takes the connection for dead
UNAVAILABLE = "UNAVAILABLE"


def timestamp(at: float) -> str:
    """ISO 8601 in UTC, milliseconds. at : Unix time (s)"""
    return datetime.fromtimestamp(at, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def clean(text: str) -> str:
    """Text that ends neither its field nor its line: a bar is escaped as the protocol has it, what is no character is left out."""
    line = " ".join("".join(char if char.isprintable() else " " for char in text).split())
    return '"' + line.replace("|", "\\|") + '"' if "|" in line else line


def condition_lines(before: Value, now: Value) -> list[Active]:
    """What has to be told of a condition: what became active or changed, what is over (level NORMAL), UNAVAILABLE."""
    if now is None:
        return [Active(UNAVAILABLE, "", "")]
    active = now if isinstance(now, tuple) else ()
    was = before if isinstance(before, tuple) else ()
    if not active:
        return [Active("NORMAL", "", "")]
    codes = {one.code for one in active}
    over = [Active("NORMAL", one.code, "") for one in was if one.code not in codes]
    return over + [one for one in active if one not in was]


def lines(at: float, changes: dict[str, tuple[Value, Value]], is_condition: set[str], is_message: set[str]) -> list[str]:
    """Lines for what changed. changes : per id what it was and what it is"""
    stamp = timestamp(at)
    told = []
    for name, (before, now) in changes.items():
        if name in is_condition:
            told += [f"{stamp}|{name}|{one.level}|{clean(one.code)}|||{clean(one.text)}" for one in condition_lines(before, now)]
            continue
        text = UNAVAILABLE if now is None else clean(str(now))
        told.append(f"{stamp}|{name}||{text}" if name in is_message else f"{stamp}|{name}|{text}")
    return told


def asset_lines(at: float, asset_id: str, kind: str, document: str) -> list[str]:
    """An asset over several lines. document : its XML"""
    tag = f"--multiline--{asset_id}"
    return [f"{timestamp(at)}|@ASSET@|{asset_id}|{kind}|{tag}", *document.splitlines(), tag]


def answer(line: str) -> str | None:
    """The answer to a line of the agent; None where nothing is to be said."""
    return f"* PONG {HEARTBEAT_MS}" if line.strip().upper().startswith("* PING") else None
