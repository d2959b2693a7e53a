"""``clearway identify --fly``: a flight in free air that shows what a contract has to declare."""
