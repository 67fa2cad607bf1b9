"""A demonstration: programs, the scenes that they are sent in, and what became of them."""
