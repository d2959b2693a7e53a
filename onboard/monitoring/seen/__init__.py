"""The seen-free set as it is fed: which frames count, and what takes the set away."""
