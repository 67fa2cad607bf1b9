"""A camera as a node: blocks as pictures show them, in place of what is told of them."""
