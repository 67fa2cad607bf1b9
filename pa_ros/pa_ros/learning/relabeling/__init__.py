"""Learning more from a stored transition: other programs, and hidden properties."""
