"""Parts of a contract file that belong together, and what they need of the rest."""
