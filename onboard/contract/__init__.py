"""The contract: terms, regions, clauses and the verdict (THEORY.md has the proofs)."""
