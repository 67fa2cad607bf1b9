"""Shell that puts a policy on the graph: observations in, joint commands out."""
