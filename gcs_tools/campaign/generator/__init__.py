"""Random scenarios: fields that keep a random contract, that break it, and faults."""
