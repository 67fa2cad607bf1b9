"""Batched programs, programmable and canonical networks (torch), and their tensors (NumPy)."""
