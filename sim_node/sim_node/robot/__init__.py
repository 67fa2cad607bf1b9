"""A real arm in the arena's place: measured joints and poses in, guarded joint velocities out."""
