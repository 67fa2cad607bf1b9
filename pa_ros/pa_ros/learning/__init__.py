"""Replay buffer, relabeling, algorithms, checkpoints and the loop."""
