"""Standard streams that the process which started this one has closed (`2>&-`, some daemons)."""

from __future__ import annotations

import os
import sys


def open_standard_streams() -> None:
    """Open the null device in place of each closed one of stdin, stdout and stderr.

    Otherwise the next file or socket gets the stream's number, and messages of C code go there.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            descriptor = os.open(os.devnull, os.O_RDWR)  # the lowest free number: the stream's
            os.set_inheritable(descriptor, True)
            setattr(sys, name, open(descriptor, mode))
