"""Pictures of scores, tables and detectors."""
