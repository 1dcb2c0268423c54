"""What the papers claim, and what FTLab promises of its own scenarios, over many runs.

Every flight is seeded, so a test that passes passes again. "False failure" in a docstring is the probability that a
right program would have failed it with another seed.
"""
