"""What the daemon counts, for Prometheus: its ticks, events, drops, ages, battery and margins."""
