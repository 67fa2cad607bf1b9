"""Algorithms by name; each with the same files: config, engine, learner."""
