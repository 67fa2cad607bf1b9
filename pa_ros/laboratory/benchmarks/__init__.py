"""What the docs say about speed and about other libraries, measured again."""
