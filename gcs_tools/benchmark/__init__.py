"""``clearway benchmark``: public scenes, flown as their own rule says, beside what peers report."""
