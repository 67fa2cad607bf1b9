"""How large a program may be, so that hostile text can neither hang nor overflow anything.

The largest program of the paper (novel shape and color, appendix) has 96 characters in canonical
form, 17 nodes, and is 5 deep.
"""

MAX_LENGTH = 4096
"""Characters of program text, white space included; holds for the canonical form too."""

MAX_DEPTH = 32
"""Nested expressions: a word is 1 deep, an operator one deeper than its deepest argument."""

MAX_RELATIONS = 16
"""Relations that the programs of one world may use."""

MAX_NODES = 256
"""Words and operators in the target expression; a flat program has at most as many instructions."""
