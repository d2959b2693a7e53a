"""Who sent it: key files, signed operator commands, and what must be remembered over a restart."""
