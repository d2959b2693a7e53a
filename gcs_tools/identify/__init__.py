"""``clearway identify``: contract values from recorded flights."""
