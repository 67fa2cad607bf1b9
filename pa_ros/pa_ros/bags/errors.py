"""Errors of this room; `code` says what kind (listed in docs/tools.md)."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class BagError(PaError):
    """A bag that cannot be written, read or used."""

    code = "bag"


class BagFullError(BagError):
    """The disk took no more. What was written before is kept."""

    code = "bag.full"


class ProvenanceError(BagError):
    """A recording that does not say how it was made, or cannot be repeated."""

    code = "bag.provenance"
