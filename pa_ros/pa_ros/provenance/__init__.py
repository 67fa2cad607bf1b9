"""Who made what, with which settings."""
