"""Seeded faults of a flight in virtual time."""
