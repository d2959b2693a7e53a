"""The simulated world: obstacles, sensors, imperfect links, ground truth."""
