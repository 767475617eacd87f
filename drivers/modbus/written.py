"""What one device was told, and whether its read-backs and its heartbeat agree with that."""

from __future__ import annotations

from config.device import Device
from drivers.interfaces import Clock
from drivers.modbus.readback import Disagreements, Heartbeat
from drivers.modbus.readings import Readings
from drivers.modbus.registers import LIMITS, decode, encode
from drivers.modbus.restarts import Restarts

HEARTBEAT, ECHO = "heartbeat", "heartbeat_readback"
ECHO_S = 0.5  # least time for an echo: a slow device shows it in its next reading, however short its dead-man is
TRIPPED_SHARE = 0.9  # of the dead-man's time: a heartbeat that has not come back for so long when outputs fall back is why they did


class Written(Readings):
    """Registers as they were taken by the device, against what was read from it."""

    def __init__(self, device: Device, clock: Clock) -> None:
        super().__init__(device, clock)
        self.disagreements = Disagreements()
        self.heartbeat = Heartbeat(int(LIMITS.get(device.registers[HEARTBEAT].type, (0, 0xFFFF))[1]), max(device.dead_man_s, ECHO_S))
        registers = device.registers
        self.desired: dict[str, float] = {
            name: register.safe for name, register in registers.items() if register.safe is not None and name != HEARTBEAT
        }
        self._write_only: set[str] = set()
        self._proven: dict[str, list[int]] = {}  # what was read from a set-point's own table since it was written
        self._written: dict[str, list[int]] = {}
        self._written_at: dict[str, float] = {}
        self.restarts = Restarts()

    @property
    def unfollowed_s(self) -> float:
        """How long the heartbeat has not come back, if for so long that the dead-man has tripped; else 0 (s)."""
        behind_s = self.heartbeat.behind_s(self.clock.now())
        return behind_s if behind_s > TRIPPED_SHARE * self.device.dead_man_s else 0.0

    def _back(self, name: str, value: float) -> str:
        why = f"it has not followed the heartbeat for {self.unfollowed_s:.1f} s" if self.unfollowed_s else ""
        return f"{name} is back at {value:g}: {why}" if why else f"{name} is back at {value:g} by itself"

    def holds(self, name: str) -> bool:
        """Whether the device was told what is wanted and, where this can be read, holds it."""
        register, written = self.device.registers[name], self._written.get(name)
        if written is None or written != encode(register, self.desired[name]):
            return False
        if register.readback is None:
            return name in self._write_only or self._proven.get(name) == written
        reading = self.readings.get(register.readback)
        is_near = reading is not None and abs(decode(register, written) - reading.value) <= register.readback_tolerance + abs(register.scale) / 2
        return is_near and reading is not None and reading.at >= self._written_at[name]

    def _judge(self, name: str, written: list[int] | None, held: list[int]) -> None:
        if written is None or written != self._written.get(name):
            return
        register = self.device.registers[name]
        if written == held:
            self._proven[name] = held
            self.disagreements.agree(name)
            return
        if self._proven.get(name) == written and register.safe is not None and held == encode(register, register.safe):
            self.restarts.sign(self._back(name, register.safe))
        told, holds = decode(register, written), decode(register, held)
        self.disagreements.differ(name, f"{name} is {told:g} {register.unit}, the device holds {holds:g}", self.clock.now())
        self._written.pop(name, None)

    def _compare(self) -> None:
        """Set-points against their read-back registers, heartbeat against its echo."""
        now = self.clock.now()
        for name, register in self.device.registers.items():
            reading = self.readings.get(register.readback) if register.readback else None
            if reading is None or name not in self._written or reading.at < self._written_at[name]:
                continue
            told, band = decode(register, self._written[name]), register.readback_tolerance + abs(register.scale) / 2
            if abs(told - reading.value) <= band:
                self._proven[name] = self._written[name]
                self.disagreements.agree(name)
                continue
            if self._proven.get(name) == self._written[name] and register.safe is not None and abs(register.safe - reading.value) <= band:
                self.restarts.sign(self._back(name, reading.value))
            self.disagreements.differ(name, f"{name} is {told:g} {register.unit}, reads {reading.value:g}", now)
            self._written.pop(name)
        echo = self.readings.get(ECHO)
        if echo is not None:
            if self.heartbeat.is_forgotten(echo.value):
                self.restarts.sign("its heartbeat echo began anew")
            self.heartbeat.echo(echo.value, echo.at)
