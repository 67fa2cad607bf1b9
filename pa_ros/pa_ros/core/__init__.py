"""Types and errors that every room of the house shares; depends on NumPy alone."""
