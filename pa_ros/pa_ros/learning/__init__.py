"""ReplayBuffer, exploration noise, actor, DPG, checkpoints and the loop."""
