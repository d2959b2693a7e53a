"""``clearway contract``: show, solve, surface."""
