"""What makes the simulated autopilot a PX4 or an ArduPilot."""
