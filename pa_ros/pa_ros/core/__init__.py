"""What every room shares: records, errors, settings, registries, the version."""

__version__ = "0.2.0"
