from hypothesis import Phase, settings

# A loaded machine must not fail a test: nothing here is timed but the benchmarks.
settings.register_profile("clearway", deadline=None)
# A mutant that was noticed need not be noticed at its simplest.
settings.register_profile(
    "mutation", deadline=None, max_examples=40, phases=(Phase.explicit, Phase.generate)
)
settings.load_profile("clearway")
