"""Statements of a contract that belong together."""
