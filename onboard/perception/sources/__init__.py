"""One decoder for each kind of sensor message."""
