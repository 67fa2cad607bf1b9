"""Faults on purpose: processes killed, messages lost, full disks; and what came of it."""
