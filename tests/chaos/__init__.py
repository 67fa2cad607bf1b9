"""Fault injection: what a live graph does when things break (FAULTS.md)."""
