"""Files that one process has for itself."""

from __future__ import annotations

import fcntl


def take_lock(descriptor: int) -> bool:
    """Lock an open file or folder until it is closed or the process ends; whether no other has it.

    A file system without locks has none to refuse: there nothing keeps two apart.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True
