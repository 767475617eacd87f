"""Modbus TCP and RTU devices, their register maps as data."""
