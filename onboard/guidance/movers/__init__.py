"""Against movers: what speaks against a way to rest, how to stop earlier, and waiting (YIELD)."""
