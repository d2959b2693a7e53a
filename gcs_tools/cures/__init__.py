"""What is wrong and what to do about it, for every refusal, hold, event and failed check."""
