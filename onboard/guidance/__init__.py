"""The induction automaton: which phase the flight is in, and what is flown in it."""
