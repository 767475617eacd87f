"""The cell process: one machine, its wires, its states, its safety tick and its journal."""
