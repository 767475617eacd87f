"""Measurements that print tables: `python -m tests.bench`."""
