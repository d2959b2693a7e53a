"""Checks how the vehicle responds: tracking, tilt, wind, and who else commands it."""
