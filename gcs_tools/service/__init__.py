"""``clearway service``: the daemon as a systemd service of the vehicle's computer."""
