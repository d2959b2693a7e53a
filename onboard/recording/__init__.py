"""What a flight leaves behind: records, flight logs, scenes for viewers."""
