"""Toy FMUs, built once a session (fixtures shared with tests/ssp)."""

from conftest_toys import build_toy, toys  # noqa: F401
