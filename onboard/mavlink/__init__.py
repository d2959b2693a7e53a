"""MAVLink without I/O, and the connections that carry it."""
