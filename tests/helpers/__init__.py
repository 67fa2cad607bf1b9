"""Builders, stand-ins and running graphs that several tests share."""
