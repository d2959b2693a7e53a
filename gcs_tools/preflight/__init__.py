"""``clearway preflight``: contract, field, vehicle and detections checked before a flight."""
