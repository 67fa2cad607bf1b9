"""Studies of trained agents: experiments, their tables and figures."""
