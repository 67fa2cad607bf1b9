"""The laboratory: studies of trained agents, and benchmarks. It is beside the package, not in it.

`pa_ros experiment`, `figures` and `ship` find it in a clone; `make bench NAME=learner` measures.
"""
