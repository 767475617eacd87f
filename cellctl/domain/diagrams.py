"""`python -m cellctl.domain.diagrams` writes STATES.md: the two tables of states and events, drawn and listed."""

from __future__ import annotations

from pathlib import Path

from cellctl.domain import jobs, states

FILE = Path(__file__).with_name("STATES.md")


def document() -> str:
    """Markdown with a mermaid picture of each table and the table itself."""
    cell = [(state.value, trigger.value, target.value) for (state, trigger), target in states.TRANSITIONS.items()]
    job = [(state.value, event.value, target.value) for (state, event), target in jobs.TRANSITIONS.items()]
    return "\n".join(
        [
            "# States and events",
            "",
            "Written by `python -m cellctl.domain.diagrams` from the tables in `states.py` and `jobs.py`; a test fails when it differs from them.",
            "What is not in a table raises and changes nothing.",
            *_section("The cell", states.mermaid(), cell),
            *_section("A job", jobs.mermaid(), job),
            "",
        ]
    )


def _section(title: str, picture: str, rows: list[tuple[str, str, str]]) -> list[str]:
    listed = [f"| {state} | {event} | {target} |" for state, event, target in rows]
    return ["", f"## {title}", "", "```mermaid", picture, "```", "", "| state | event | becomes |", "|---|---|---|", *listed]


if __name__ == "__main__":
    FILE.write_text(document(), encoding="utf-8")
