"""Shell that puts the learner on the graph: transitions in, policy weights out."""
