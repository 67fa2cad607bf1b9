"""Experience kept for learning, and the account of what arrived."""
