"""The MAVLink microservices of the simulated autopilot."""
