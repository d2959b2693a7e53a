"""Reads the logs of a flight, and derives its result."""
