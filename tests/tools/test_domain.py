"""Graphs that are yet to start don't meet, whoever claims domains for them."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.tools import domain
from pa_ros.tools.domain import DomainClaim, use_domain


def test_claims_side_by_side_are_for_different_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    with DomainClaim() as first:
        monkeypatch.setattr(domain, "DOMAINS", (first.number,))
        with pytest.raises(ConfigError, match="every one is in use"):
            DomainClaim()
        code = "from pa_ros.tools import domain; domain.DOMAINS = ({},); domain.DomainClaim()"
        command = [sys.executable, "-c", code.format(first.number)]
        other = subprocess.run(command, capture_output=True, text=True)
        assert "every one is in use" in other.stderr
    with DomainClaim() as again:
        assert again.number == first.number


def test_a_domain_is_chosen_for_this_process_and_its_children(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    number = use_domain(None)
    assert number in domain.DOMAINS and os.environ["ROS_DOMAIN_ID"] == str(number)
    assert use_domain(0) == 0 and os.environ["ROS_DOMAIN_ID"] == "0"
    for wrong in (-1, 102):
        with pytest.raises(ConfigError, match=str(wrong)):
            use_domain(wrong)
