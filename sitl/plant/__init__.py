"""The simulated vehicle's physics: rigid body, controller, estimator, wind, battery."""
