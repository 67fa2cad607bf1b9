"""Benchmarks: what the docs say about speed and about other libraries, measured again.

Not part of the package. Run one with `make bench NAME=learner`, from the repository's root.
"""
