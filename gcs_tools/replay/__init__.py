"""``clearway replay``: what the daemon would have seen of a recording of sensors."""
