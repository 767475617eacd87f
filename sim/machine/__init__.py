"""The machine as solids, and what of it meets what: on every piece of motion, with nothing tunnelled through."""

from sim.machine.machine import Approach, Hit, Machine

__all__ = ["Approach", "Hit", "Machine"]
