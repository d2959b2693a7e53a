"""``clearway watch``: a flight as it happens."""
