"""A camera as a node: it replaces the blocks of observations by those that pictures show."""
