"""Monitors of how the vehicle responds: tracking, tilt, wind, and a second commander."""
