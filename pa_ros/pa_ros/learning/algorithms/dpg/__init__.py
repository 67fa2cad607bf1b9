"""Deterministic policy gradient (paper, appendix "Training parameters")."""
