"""Tools that people start on the graph: launch, watch, send, record, play back."""
