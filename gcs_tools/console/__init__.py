"""Shared by all commands: arguments, output, progress, errors, child processes."""
