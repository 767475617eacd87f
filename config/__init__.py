"""Facts, no logic: validated models with units in field names and bounds beside the field, and the TOML and parts shipped with them."""

from config.base import ConfigError, Facts, explain, find_facts, parse_facts, read_facts
from config.cell import Axis, Cell, Joint, Kinematics, Link, Nozzle, Placement, Tool, load_cell
from config.device import Device, Register, load_device
from config.machine import Clamps, MachineGeometry, ProofLimits, Solid
from config.material import Material, load_material

__all__ = [
    "Axis",
    "Cell",
    "Clamps",
    "ConfigError",
    "Device",
    "Facts",
    "Joint",
    "Kinematics",
    "Link",
    "MachineGeometry",
    "Material",
    "Nozzle",
    "Placement",
    "ProofLimits",
    "Register",
    "Solid",
    "Tool",
    "explain",
    "find_facts",
    "load_cell",
    "load_device",
    "load_material",
    "parse_facts",
    "read_facts",
]
