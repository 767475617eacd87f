"""Readers under damaged and hostile input: hypothesis in the tests, atheris by `python -m tests.fuzz.stl` and the like."""
