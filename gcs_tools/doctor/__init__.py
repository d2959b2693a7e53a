"""``clearway status`` and ``clearway doctor``: what the daemon does, and what it lacks to fly."""
