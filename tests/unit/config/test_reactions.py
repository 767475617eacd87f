"""Reactions in a cell file: safe defaults, stricter ones taken, weaker ones refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from config.base import ConfigError, find_facts
from config.cell import Cell, load_cell
from config.reactions import DEFAULTS, MAY_PASS, MAY_RETRACT


def cell_with(folder: Path, text: str) -> Cell:
    shipped = find_facts("cells", "trunnion_tcp").read_text(encoding="utf-8")
    file = folder / "mine.toml"
    file.write_text(shipped + "\n" + text, encoding="utf-8")
    return load_cell(file)


def test_a_cell_file_without_reactions_has_the_safe_defaults() -> None:
    assert load_cell("trunnion_tcp").reactions == DEFAULTS
    assert all(reaction.laser == "off" and reaction.latch and reaction.powder == "off" for reaction in DEFAULTS.values())


def test_a_stricter_reaction_is_taken_and_what_is_not_said_stays_the_default(tmp_path: Path) -> None:
    cell = cell_with(tmp_path, '[reactions.chiller]\nmotion = "reset"\nretract = true\n[reactions.gas_pressure]\nlatch = false\n')
    chiller = cell.reactions["chiller"]
    assert (chiller.motion, chiller.retract, chiller.latch, chiller.powder) == ("reset", True, True, "off")
    assert not cell.reactions["gas_pressure"].latch
    assert cell.reactions["door"] == DEFAULTS["door"]


def test_reactions_and_the_way_of_a_retract_do_not_change_what_a_program_was_posted_for(tmp_path: Path) -> None:
    changed = cell_with(tmp_path, '[reactions.chiller]\nmotion = "reset"\n[limits]\nretract_mm = 5.0\n')
    assert changed.sha256 == load_cell("trunnion_tcp").sha256


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[reactions.estop]\nmotion = "hold"', "estop.motion"),
        ("[reactions.cnc_lost]\nends_job = false", "cnc_lost.ends_job"),
        ("[reactions.door]\nlatch = false", "door.latch"),
        ("[reactions.door]\nretract = true", "door.retract"),
        ('[reactions.door]\npowder = "keep"', "door.powder"),
        ('[reactions.door]\nlaser = "on"', "door.laser"),
        ('[reactions.door]\npowder = "spill"', "door.powder"),
        ("[reactions.doors]\nlatch = true", "doors"),
        ("[reactions]\ndoor = 3", "door"),
        ("[reactions.chiller]\nlatch = false\nretract = true", "chiller.latch"),
        ('[reactions.chiller]\npowder = "divert"', "diverter"),
    ],
)  # fmt: skip
def test_a_reaction_below_the_floor_is_refused_in_one_line_that_names_it(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigError) as refused:
        cell_with(tmp_path, text + "\n")
    assert words in refused.value.message and "\n" not in refused.value.message
    assert refused.value.hint


def test_whatever_may_pass_without_a_latch_neither_ends_a_job_nor_drops_the_stream() -> None:
    for name in MAY_PASS:
        assert not DEFAULTS[name].stops_job and not DEFAULTS[name].drops_stream
    assert not {"door", "estop", "io_silent", "cnc_silent"} & MAY_RETRACT
