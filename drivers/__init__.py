"""The near end of the wires: one plain class per device."""
