"""`cellctl doctor`: looks a cell over before it works. It reads; it writes, moves or lets gas flow only where an option says so.

What is looked at, one file each: `ports` (serial ports and who answers), `cnc` (firmware, axes, buffers, latency), `settings` (the
control's `$` numbers against the cell file), `modbus` (devices, request times), `registers` (every register with its meaning),
`dead_man` (timers that are let expire), `hands` (E-stop, door, chiller, gas, extraction, by asking for them), `jogs` (direction and
distance of each axis, where moving is allowed). `report` holds the verdicts, `page` prints them.
"""

from cellctl.doctor.examine import examine_cell
from cellctl.doctor.options import DoctorError, Options
from cellctl.doctor.report import Check, Report, Verdict

__all__ = ["Check", "DoctorError", "Options", "Report", "Verdict", "examine_cell"]
