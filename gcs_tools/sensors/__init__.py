"""``clearway sensor``: what arrives from the sensors of a daemon's file, and why nothing does."""
