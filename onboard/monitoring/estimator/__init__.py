"""Checks the autopilot's estimate: position quality, resets, heading."""
