"""The near end of the wires: one plain class per device."""

from drivers.cell_wires import CellDrivers, open_cell, open_cnc, open_devices

__all__ = ["CellDrivers", "open_cell", "open_cnc", "open_devices"]
