"""The simulated autopilot: its decisions, modes, failsafes and missions."""
