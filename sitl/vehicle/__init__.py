"""One simulated vehicle, and the scene that it flies in."""
