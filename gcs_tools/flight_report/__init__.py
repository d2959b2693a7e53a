"""``clearway report``: a flight as one HTML file."""
