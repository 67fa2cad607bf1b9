"""Programmable Agents (Denil et al. 2017): arms that execute declarative programs."""

__version__ = "0.2.0"
