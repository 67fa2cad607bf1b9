"""What things cost; no node imports this room."""
