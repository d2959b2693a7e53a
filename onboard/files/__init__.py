"""File and wire formats that daemon, simulation and operator share."""
