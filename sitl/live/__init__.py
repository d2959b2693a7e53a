"""The simulation in real time: sockets, Zenoh, the clock."""
