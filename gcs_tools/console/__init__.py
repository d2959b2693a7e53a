"""What every command shares with its terminal: output, progress, errors, child processes."""
