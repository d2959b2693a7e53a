"""Reads the logs of a flight, and says what came of it."""
