"""How well a policy does: episodes, references, scores with their intervals."""
