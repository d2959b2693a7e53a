"""``clearway resume`` and ``clearway return``: end a hold, or fly back."""
