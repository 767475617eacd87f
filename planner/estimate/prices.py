"""What time, powder and gas cost by the rates that the shop wrote into its files; nothing is assumed where one is missing."""

from __future__ import annotations

from dataclasses import dataclass

from config.cell import Cell
from config.material import Material


@dataclass(frozen=True)
class Cost:
    """In `currency`: the machine's hours, the powder that is fed, the gas; total is their sum."""

    currency: str
    machine: float
    powder: float
    gas: float
    total: float


@dataclass(frozen=True)
class Missing:
    """A rate that nobody has stated.  file : "cell" or "material"   name : which one   field : in it   unit : of the field"""

    file: str
    name: str
    field: str
    unit: str


def cost_of(time_s: float, powder_g: float, gas_l: float, material: Material, cell: Cell) -> tuple[Cost | None, tuple[Missing, ...]]:
    """The cost of a build, or which rates are missing for it.  time_s : on the machine   powder_g : fed   gas_l : at 1 bar"""
    rates, price = cell.rates, material.price
    currency = rates.currency if rates is not None else "currency"
    missing = []
    if rates is None or rates.machine_per_h is None:
        missing.append(Missing("cell", cell.name, "rates.machine_per_h", f"{currency}/h"))
    if rates is None or rates.gas_per_m3 is None:
        missing.append(Missing("cell", cell.name, "rates.gas_per_m3", f"{currency}/m³"))
    if price is None or (rates is not None and price.currency != rates.currency):
        missing.append(Missing("material", material.name, "price.per_kg", f"{currency}/kg"))
    if rates is None or price is None or rates.machine_per_h is None or rates.gas_per_m3 is None or missing:
        return None, tuple(missing)
    machine, powder, gas = rates.machine_per_h * time_s / 3600.0, price.per_kg * powder_g / 1000.0, rates.gas_per_m3 * gas_l / 1000.0
    return Cost(rates.currency, machine, powder, gas, machine + powder + gas), ()
