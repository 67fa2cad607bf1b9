"""Graphs that start at the same time get different domains."""

import os

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.tools import domain
from pa_ros.tools.domain import DomainClaim, use_free_domain


def test_a_claimed_domain_is_not_given_again_until_it_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with DomainClaim() as first:
        monkeypatch.setattr(domain, "DOMAINS", (first.number,))
        with pytest.raises(ConfigError, match="every one is in use"):
            DomainClaim()
    with DomainClaim() as again:
        assert again.number == first.number


def test_a_domain_is_chosen_for_this_process_and_its_children(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    number = use_free_domain()
    assert number in domain.DOMAINS and os.environ["ROS_DOMAIN_ID"] == str(number)
