"""What a stored transition says about other programs than the one that acted."""
