"""E-stop, doors, chiller, gas and extraction, checked by asking the person at the machine to open each and watching its level."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass

from cellctl.doctor.modbus import Wired
from cellctl.doctor.options import Ask, Options
from cellctl.doctor.report import Report
from config.device import Register
from drivers.errors import DriverError
from drivers.interfaces import Clock
from drivers.modbus.registers import meanings

SECTION = "By hand"
LOOK_S = 0.02


@dataclass(frozen=True)
class Contact:
    """One contact of the I/O coupler. laser_word : what the laser's own interlock has to say when it is open; empty if it is not wired there"""

    register: str
    name: str
    open_it: str
    close_it: str
    laser_words: tuple[str, ...] = ()


CONTACTS = (
    Contact("estop_ok", "E-stop", "Press the E-stop", "Release the E-stop", ("emergency", "e-stop")),
    Contact("door_closed", "door", "Open the door", "Close the door", ("door",)),
    Contact("chiller_ok", "chiller", "Switch the chiller off", "Switch the chiller on", ("cooling", "water", "flow")),
    Contact("gas_pressure_ok", "gas pressure", "Close the gas supply", "Open the gas supply"),
    Contact("fume_extraction_ok", "fume extraction", "Switch the extraction off", "Switch the extraction on"),
)


async def ask_for_contacts(wired: Mapping[str, Wired], options: Options, clock: Clock, report: Report) -> None:
    """Every contact opened and closed again by hand. A person may skip one; who does not answer any more ends it."""
    ask: Ask | None = options.ask
    io = wired.get("io")
    for contact in CONTACTS:
        if ask is None or io is None:
            report.skip(SECTION, contact.name, "with --ask only" if ask is None else "the I/O coupler does not answer")
            continue
        try:
            if not await _check(contact, ask, io, wired.get("laser"), options.answer_s, clock, report):
                ask = None
        except DriverError as error:
            report.fault(SECTION, contact.name, error)


async def _check(
    contact: Contact, ask: Ask, io: Wired, laser: Wired | None, answer_s: float, clock: Clock, report: Report
) -> bool:
    """One contact; False when nobody answers any more."""
    if not await io.read(contact.register):
        report.add(SECTION, contact.name, "FAULT", "open before it was asked for", "closed", f"{contact.close_it.lower()}, then look again")
        return True
    answer = await ask(f"{contact.open_it} now, then Enter (s skips it)")
    if answer is None or answer.startswith("s"):
        report.skip(SECTION, contact.name, "nobody answers" if answer is None else "skipped by hand")
        return answer is not None
    is_seen = await _comes(lambda: _is(io, contact.register, False), answer_s, clock)
    report.judge(
        SECTION, f"{contact.name} opened", is_seen, "seen" if is_seen else f"{contact.register} still says closed after {answer_s:g} s",
        "open", "the contact is bridged, stuck or at another address: do not work with this cell until it is seen",
    )  # fmt: skip
    if is_seen and laser is not None and contact.laser_words:
        await _check_laser(contact, laser, answer_s, clock, report)
    answer = await ask(f"{contact.close_it}, then Enter")
    is_back = await _comes(lambda: _is(io, contact.register, True), answer_s, clock)
    report.judge(
        SECTION, f"{contact.name} closed again", is_back, "seen" if is_back else f"{contact.register} still says open after {answer_s:g} s",
        "closed", "look at the contact, and at a safety relay that wants its own reset",
    )  # fmt: skip
    return answer is not None


async def _is(io: Wired, register: str, level: bool) -> bool:
    return bool(await io.read(register)) == level


async def _check_laser(contact: Contact, laser: Wired, answer_s: float, clock: Clock, report: Report) -> None:
    """The laser's own interlock, which is hardware, has to open with the contact."""
    register: Register = laser.device.registers["interlock_word"]
    bits = [int(bit) for bit, text in register.bits.items() if any(word in text.lower() for word in contact.laser_words)]
    what = f"{contact.name} at the laser's own interlock"
    if not bits:
        report.skip(SECTION, what, "no bit of interlock_word in the register map has its name")
        return

    async def is_told() -> bool:
        value = await laser.read("interlock_word")
        return any(round((value - register.offset) / register.scale) >> bit & 1 for bit in bits)

    is_seen = await _comes(is_told, answer_s, clock)
    text = ", ".join(meanings("interlock_word", register, await laser.read("interlock_word"))) or "interlock_word says nothing"
    report.judge(SECTION, what, is_seen, text, "open", "wire the contact to the laser's own interlock: software is not the safety system")


async def _comes(is_met: Callable[[], Awaitable[bool]], timeout_s: float, clock: Clock) -> bool:
    until = clock.now() + timeout_s
    while not await is_met():
        if clock.now() >= until:
            return False
        await clock.sleep(LOOK_S)
    return True
