"""``clearway fleet``: several vehicles at one site."""
