"""The simulated vehicle's physics: rigid body, controller, wind, battery."""
