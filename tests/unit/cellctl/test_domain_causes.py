"""Reports of one cause: the same alarm whichever comes first."""

from __future__ import annotations

from itertools import permutations

import pytest

from cellctl.domain.causes import CNC_ALARM_CAUSE, EXPLAINS, cause_of_alarm, causes_of_interlocks, is_explained
from config.device import load_device
from config.reactions import DEFAULTS
from drivers.cnc.codes import ALARMS

WRONG = "generic fibre laser: wrong value read back: enable is 1, the device holds 0"


def latched(reports: list[tuple[str, str]]) -> set[str]:
    """What stays when reports come one after the other: what is explained is left out, what a later one explains goes."""
    found: dict[str, str] = {}
    for code, detail in reports:
        if not any(is_explained(code, detail, by=known) for known in found):
            found = {known: words for known, words in found.items() if not is_explained(known, words, by=code)}
            found[code] = detail
    return set(found)


@pytest.mark.parametrize(
    ("reports", "cause"),
    [
        ([("estop", ""), ("laser_interlock", "emergency stop chain open"), ("cnc_alarm", "ALARM:10 emergency stop")], {"estop"}),
        ([("estop", ""), ("cnc_alarm", "ALARM:3 the controller was reset while the machine moved"), ("cnc_reset", "Grbl 1.1h")], {"estop"}),
        ([("estop", ""), ("feeder_fault", "powder feeder: wrong value read back: rate is 10 g/min, reads 0")], {"estop"}),
        ([("door", "door interlock open"), ("laser_fault", WRONG)], {"door"}),
        ([("chiller", ""), ("laser_interlock", "cooling water flow low")], {"chiller"}),
        ([("gas_pressure", ""), ("powder_flow", "3.0 of 10.0 g/min"), ("gas_flow", "0.1 L/min read back")], {"gas_pressure"}),
        ([("laser_interlock", "fibre not connected"), ("laser_fault", WRONG)], {"laser_interlock"}),
        ([("estop", ""), ("cnc_alarm", "ALARM:1 a limit switch was hit")], {"estop", "cnc_alarm"}),
        ([("chiller", ""), ("laser_interlock", "cooling water flow low; fibre not connected")], {"chiller", "laser_interlock"}),
        ([("estop", ""), ("laser_fault", f"{WRONG}; power module")], {"estop", "laser_fault"}),
        ([("door", ""), ("gas_pressure", "")], {"door", "gas_pressure"}),
    ],
)  # fmt: skip
def test_reports_of_one_cause_leave_the_same_alarms_in_every_order(
    reports: list[tuple[str, str]], cause: set[str]
) -> None:
    assert [latched(list(order)) for order in permutations(reports)] == [cause] * len(list(permutations(reports)))


def test_an_interlock_word_that_names_the_door_is_an_open_door() -> None:
    assert causes_of_interlocks(["door interlock open"]) == [("door", "door interlock open")]
    assert causes_of_interlocks(["Guard open"]) == [("door", "Guard open")]
    assert causes_of_interlocks(["door interlock open", "fibre not connected"]) == [
        ("door", "door interlock open"),
        ("laser_interlock", "fibre not connected"),
    ]
    assert causes_of_interlocks([]) == []


def test_an_open_estop_chain_tells_nothing_of_what_comes_behind_it() -> None:
    (found,) = causes_of_interlocks(["emergency stop chain open", "door interlock open"])
    assert found[0] == "laser_interlock" and is_explained(*found, by="estop")


def test_every_bit_of_the_shipped_lasers_interlock_word_has_its_cause() -> None:
    bits = load_device("laser_generic").registers["interlock_word"].bits
    found = {text: causes_of_interlocks([text])[0] for text in bits.values()}
    causes = {
        text: next((cause for cause in ("estop", "chiller") if is_explained(*report, by=cause)), report[0])
        for text, report in found.items()
    }
    assert causes == {
        "emergency stop chain open": "estop",
        "door interlock open": "door",
        "cooling water flow low": "chiller",
        "fibre not connected": "laser_interlock",
    }


def test_alarm_numbers_of_the_cnc_that_name_door_or_estop_stand_for_them() -> None:
    assert cause_of_alarm(7) == "door" and "door" in ALARMS[7][0]
    assert cause_of_alarm(10) == "estop" and "emergency stop" in ALARMS[10][0]
    assert {cause_of_alarm(number) for number in ALARMS if number not in CNC_ALARM_CAUSE} == {"cnc_alarm"}
    assert cause_of_alarm(None) == "cnc_alarm"


def test_what_is_left_out_is_never_the_harsher_report() -> None:
    """Whatever a cause explains stops no more than the cause itself: leaving it out loses no reaction."""
    for cause, explained in EXPLAINS.items():
        for code in explained:
            assert DEFAULTS[cause].ends_job >= DEFAULTS[code].ends_job
            assert (DEFAULTS[cause].motion == "reset") >= (DEFAULTS[code].motion == "reset")
            assert (DEFAULTS[cause].powder == "off") >= (DEFAULTS[code].powder == "off")
