"""What differs between autopilots, one profile each; no other code branches on the autopilot."""
