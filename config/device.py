"""Facts about one Modbus device: its register map as data (design.md: never invent a vendor's map, never hard-code one)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from config.base import Facts, Finite, NotNegative, Positive, find_facts, read_facts

Role = Literal["laser", "feeder", "io"]
Table = Literal["coil", "discrete", "input", "holding"]
DataType = Literal["bit", "uint16", "int16", "uint32", "int32", "float32"]

# Names that the drivers look up, by role. A map must define them all. A feeder's coil `diverter` (1: powder goes to the bypass, its safe
# value) is used where it is there, and so is a laser's coil `pilot` (1: aiming beam on, its safe value 0); anything more is shown and
# recorded but not used.
REQUIRED: dict[str, frozenset[str]] = {
    "laser": frozenset({
        "enable", "emission_permit", "power_setpoint", "heartbeat",
        "power_readback", "emission", "interlock_word", "fault_word", "heartbeat_readback", "fault_reset",
    }),
    "feeder": frozenset({
        "rate_setpoint", "carrier_gas_setpoint", "shield_gas_setpoint", "heartbeat",
        "rate_readback", "carrier_gas_readback", "shield_gas_readback", "hopper_level", "fault_word", "heartbeat_readback", "fault_reset",
    }),
    "io": frozenset({
        "estop_ok", "door_closed", "chiller_ok", "gas_pressure_ok", "fume_extraction_ok",
        "head_deploy", "head_deployed", "head_parked", "heartbeat", "heartbeat_readback",
    }),
}  # fmt: skip


class Register(Facts):
    """One quantity on the wire. value = raw * scale + offset, in `unit`."""

    table: Table
    address: int = Field(ge=0, le=65535, description="zero-based protocol address")
    type: DataType
    word_order: Literal["big", "little"] = Field("big", description="order of 16-bit words in 32-bit values")
    scale: Finite = 1.0
    offset: Finite = 0.0
    unit: str = ""
    min: Finite | None = Field(None, description="least value that may be written, in unit")
    max: Finite | None = Field(None, description="greatest value that may be written, in unit")
    safe: Finite | None = Field(None, description="value written on any stop; required on everything that can be written")
    stale_s: Positive = Field(0.5, description="a reading older than this is an unsafe one")
    readback: str | None = Field(None, description="name of the register in which a written value shows")
    readback_tolerance: NotNegative = Field(0.0, description="largest difference of set-point and read-back once settled, in unit")
    bits: dict[str, str] = Field(default_factory=dict, description="bit number -> meaning, for words of flags")

    @property
    def writable(self) -> bool:
        """Whether the table can be written (coil, holding)."""
        return self.table in ("coil", "holding")

    @property
    def is_level(self) -> bool:
        """Whether safety may hang on it: a bit, a word of flags, or a count of what happened."""
        return self.type == "bit" or bool(self.bits) or self.unit == "count"

    @property
    def count(self) -> int:
        """Number of 16-bit registers (or coils) that the value takes."""
        return 2 if self.type in ("uint32", "int32", "float32") else 1

    @model_validator(mode="after")
    def _consistent(self) -> Register:
        if (self.table in ("coil", "discrete")) != (self.type == "bit"):
            raise ValueError(f"type {self.type} does not fit table {self.table}")
        if self.writable and self.safe is None:
            raise ValueError("a register that can be written needs a safe value")
        if self.scale == 0:
            raise ValueError("scale must not be 0")
        return self


class Device(Facts):
    """A register map and the timing of one device."""

    schema_version: Literal[1]
    name: str
    role: Role
    source: str = Field(description="document that the map was read from")
    timeout_s: Positive = Field(0.1, le=2.0, description="per request")
    poll_s: Positive = Field(0.02, description="reading period while connected")
    dead_man_s: Positive = Field(0.5, description="the device turns its outputs safe this long after the last heartbeat")
    latency_s: NotNegative = Field(0.0, description="from the begin of a write to its effect; to begin with, then it is learnt")
    ramp_s: NotNegative = Field(0.0, description="time constant of the output behind it (laser); to begin with, then it is learnt")
    flow_sensed_at: Literal["nozzle", "feeder"] = Field("nozzle", description="where a feeder's rate_readback is measured")
    registers: dict[str, Register]

    @model_validator(mode="after")
    def _complete(self) -> Device:
        missing = sorted(REQUIRED[self.role] - set(self.registers))
        if missing:
            raise ValueError(f"role {self.role} needs register(s) {', '.join(missing)}")
        for name, register in self.registers.items():
            if register.readback is not None and register.readback not in self.registers:
                raise ValueError(f"{name}.readback names {register.readback}, which is not in the map")
        self._check_diverter()
        pilot = self.registers.get("pilot")
        if self.role == "laser" and pilot is not None and (pilot.type != "bit" or pilot.safe != 0.0):
            raise ValueError("pilot has to be a coil with safe = 0 (the aiming beam is off)")
        taken: dict[tuple[str, int], str] = {}
        for name, register in self.registers.items():
            for address in range(register.address, register.address + register.count):
                other = taken.setdefault((register.table, address), name)
                if other != name:
                    raise ValueError(f"{name} and {other} share {register.table} {address}")
        return self

    def _check_diverter(self) -> None:
        diverter = self.registers.get("diverter")
        if self.role == "feeder" and diverter is not None and (diverter.type != "bit" or diverter.safe != 1.0):
            raise ValueError("diverter has to be a coil with safe = 1 (powder goes to the bypass)")


def load_device(name: str) -> Device:
    """Device by path or shipped name. Raises ConfigError."""
    return read_facts(Device, find_facts("devices", name))
