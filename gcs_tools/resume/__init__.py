"""``clearway resume``: the operator ends a hold whose cause has ended."""
