from hypothesis import Phase, settings

# A loaded machine must not fail a test: only the benchmarks measure time.
settings.register_profile("clearway", deadline=None)
# Shrinking a failure that detects a mutant would only take time.
settings.register_profile(
    "mutation", deadline=None, max_examples=12, phases=(Phase.explicit, Phase.generate)
)
settings.load_profile("clearway")
