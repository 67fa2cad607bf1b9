"""The page: what an arena and its agent do, live or from a recording, in a browser."""
