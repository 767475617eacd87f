"""The simulated devices' Modbus side: registers on the plant's values, and servers over TCP and RTU."""
