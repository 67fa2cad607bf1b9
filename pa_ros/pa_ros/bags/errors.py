"""What is wrong with a bag: each says which file, what was expected and what was found."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class BagError(PaError):
    """A bag that cannot be written or read. Root of this room's errors."""

    code = "bag"


class BagFullError(BagError):
    """The disk refused more; what was written until then is closed and readable."""

    code = "bag.full"


class BagMovedError(BagFullError):
    """A bag whose folder was moved or deleted while it was being written: it takes no more, and a
    repair makes it readable."""

    code = "bag.moved"


class UnfinishedBagError(BagError):
    """A recording that was killed: its index and metadata are missing, its messages are not."""

    code = "bag.unfinished"


class BagInUseError(BagError):
    """A bag that someone is writing still: a recorder that lives, or a repair."""

    code = "bag.in_use"


class DamagedBagError(BagError):
    """A file that is not, or not any more, what its format says."""

    code = "bag.damaged"


class ForeignBagError(BagError):
    """A readable bag that lacks the topics that were asked for."""

    code = "bag.foreign"


class DefinitionError(BagError):
    """A message of another edition of its definition, which lacks what is needed."""

    code = "bag.definition"


class ProvenanceError(BagError):
    """A recording that does not say how it was made, or began too late to be made again."""

    code = "bag.provenance"
