"""Ways to learn from stored steps, one file each; `builder` says which one a learner uses."""
