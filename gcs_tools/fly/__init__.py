"""``clearway fly``: one command from a scenario file to a flown, logged and judged flight."""
