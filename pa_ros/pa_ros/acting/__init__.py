"""Acting: a policy's inference and exploration, and the trajectories that its steps make."""
