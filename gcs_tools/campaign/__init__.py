"""``clearway campaign``: many seeded flights, judged and counted."""
