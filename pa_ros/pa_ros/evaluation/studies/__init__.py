"""Several seeds of one setting, and studies of trained agents, as tables."""
