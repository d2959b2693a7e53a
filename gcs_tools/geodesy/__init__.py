"""Places on the Earth: angles, an autopilot's local frame, UTM."""
