"""Families of networks: one object for all that depends on the kind."""

import pytest
import torch

from helpers.worlds import PROGRAMS, WORDS, WORLD
from pa_ros.language import parse
from pa_ros.language.flat import OR
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.families import FAMILIES, codes_of, family_of
from pa_ros.world.programs import ProgramTable

NETWORK = NetworkConfig(world=WORLD, hidden=6, attention=4, canonical_hidden=8)


@pytest.mark.parametrize("name", tuple(FAMILIES))
def test_modules_take_what_they_are_told_and_have_the_tensors_of_the_table(name) -> None:
    network = NETWORK.changed(family=name)
    table = ProgramTable(WORDS)
    rows = [table.add(program) for program in PROGRAMS]
    codes = [
        torch.from_numpy(code)[torch.tensor([rows])] for code in family_of(network).codes(table)
    ]
    objects, arm = torch.rand(1, 3, 16), torch.rand(1, 18)
    for critic, module in enumerate(family_of(network).modules()):
        made = module(network)
        shapes = {k: tuple(v.shape) for k, v in made.state_dict().items()}
        assert shapes == family_of(network).shapes(network, critic=bool(critic))
        assert ("detectors.weight" in shapes) == family_of(network).detects(critic=bool(critic))
        action = [torch.rand(1, 6)] if critic else []
        answer = made(objects, arm, family_of(network).programs(*codes), *action)
        assert answer.shape[:2] == (1, len(PROGRAMS))


def test_only_families_that_evaluate_programs_are_told_every_program() -> None:
    program = parse("NEAR(HAND, RED)", WORDS)
    for name in FAMILIES:
        family, network = FAMILIES[name], NETWORK.changed(family=name)
        if family.evaluates_programs:
            family.check(program, WORDS)
            op, *_ = codes_of(program, network)
            assert op.tolist() == [[OR]]
            continue
        with pytest.raises(NetworkError):
            family.check(program, WORDS)
        with pytest.raises(NetworkError):
            codes_of(program, network)
