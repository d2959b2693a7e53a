"""The simulated autopilot: its decisions, modes, estimator and missions."""
