from hypothesis import settings

# A loaded machine must not fail a test: nothing here is timed but the benchmarks.
settings.register_profile("clearway", deadline=None)
settings.load_profile("clearway")
