"""Laws that would be others compiled than in Python, and other misuses: each is told in one sentence."""

import random
import time
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

from marsedl.fly import Below, Entry, GainTable, Normal, fly

START = {"altitude_km": 125.0, "velocity": 5500.0, "flight_path_angle_deg": -14.0}
TRIGGER = Below("velocity", 480.0)


class Bank(NamedTuple):
    bank: float


class Whole(NamedTuple):
    number: int = 2


class Source(NamedTuple):
    of: object


class Settings:
    bank = 0.3


BANKS, OBJECT, LARGE = {"steep": 1.2}, Settings(), np.zeros(200_000)


def asks_for_noise(velocity, noise):
    return noise


def misspells(sense):
    return sense.velocity


def returns_words(velocity):
    return "steep"


def returns_an_array(velocity):
    return np.array([1.2])


def returns_a_complex_number(velocity):
    return (-1.0) ** 0.5


def returns_two(velocity):
    return 1.2, 0.3


def forgets_a_path(velocity):  # noqa: RET503
    if velocity > 1000.0:
        return Bank(1.2)


def powers(velocity, law: Whole = Whole()):  # noqa: B008
    return 1.2 * law.number**-1


def alternates(time):
    return 1.2 * sign(int(time))


def sign(number):
    return (-1) ** number


def draws(law):
    return law.of.normal()


def looks_up(velocity, law):
    return law.of[0]


def noisy_by_another_name(velocity):
    module = np
    return module.random.normal()


def noisy_by_a_default(velocity):
    return drawn(velocity)


def drawn(velocity, number=random.random):
    return number()


def asks_the_clock(velocity):
    return time.time()


def reads_a_dictionary(velocity):
    return BANKS["steep"]


def reads_an_object(velocity):
    return OBJECT.bank


def reads_much(velocity):
    return LARGE[0]


def annotated(velocity) -> "tuple[Command, Memory]":  # noqa: F821
    return (1.2,), ()


def slow(state):
    return state.velocity - 480.0


NOT_OF_A_TRIAL = "whose answers belong to no trial, so that a replay would be another flight: disperse the start"
TABLE = {"velocity": [0.0, 6e3], "bank": [1.2, 1.0]}
MISUSES = [
    ({"law": asks_for_noise}, r"asks for 'noise', of which it is not told; There are: time, law, nav, sensed"),
    ({"law": misspells}, r"misspells \(.*line \d+\) asks for 'sense', .*did you mean 'sensed'\?"),
    ({"law": returns_words}, r"returns_words \(.*line \d+\) returned 'steep'; it must return bank"),
    ({"law": returns_an_array}, r"returned array\(\[1.2\]\); it must return bank"),
    ({"law": returns_a_complex_number}, r"returned \(.*1j\); it must return bank"),
    ({"law": returns_two}, r"returned \(1.2, 0.3\); it must return bank"),
    ({"law": forgets_a_path}, r"test_misuses.py, line \d+: forgets_a_path returns nothing on one of its paths"),
    ({"law": powers}, r"line \d+, in powers: an integer to the power of an integer .* as in 2.0 \*\* n"),
    ({"law": alternates}, r"line \d+, in sign: an integer to the power of an integer .* as in 2.0 \*\* n"),
    ({"law": partial(draws, law=Source(np.random.default_rng(1)))}, rf"law holds a Generator, {NOT_OF_A_TRIAL}"),
    ({"law": partial(looks_up, law=Source([1.2]))}, r"law holds a list: give numbers, arrays and NamedTuples of them"),
    ({"law": partial(looks_up, laws=1.2)}, r"is none: give a function, partial\(function, law=parameters\)"),
    ({"law": noisy_by_another_name}, rf"noisy_by_another_name \(.* reads np.random, {NOT_OF_A_TRIAL}"),
    ({"law": noisy_by_a_default}, rf"drawn \(.*line \d+\) reads number, {NOT_OF_A_TRIAL}"),
    ({"law": asks_the_clock}, rf"asks_the_clock \(.*line \d+\) reads time, {NOT_OF_A_TRIAL}"),
    ({"law": reads_a_dictionary}, r"reads BANKS, a dict whose changes a compiled flight does not see: read numbers"),
    ({"law": reads_an_object}, r"reads OBJECT, a Settings whose changes .* give all else as law=parameters"),
    ({"law": reads_much}, r"reads LARGE, a ndarray whose changes .* arrays of at most 1 MB"),
    ({"law": annotated}, r"annotated \(.*line \d+\): .*cannot be read .*define its classes at the top of the file"),
    ({"law": Settings}, r"law .*Settings.* is none: give a function"),
    ({"law": GainTable(TABLE | {"bank_per_rnge": [1.0, 1.0]})}, r"'bank_per_rnge' is unknown; did you mean 'bank_per_"),
    ({"law": GainTable(TABLE | {"bank_per_range": [1.0, 1.0]})}, r"column 'range' is missing, .* reference of a gain"),
    ({"law": Normal(1.2, 0.1)}, r"law Normal\(.*\) is none: give a function"),
    ({"trigger": slow}, r"annotate what slow \(.*line \d+\) returns: float \(its zero is found\), a named tuple"),
    ({"trigger": "velocity < 480"}, r"trigger 'velocity < 480' is none: give Below\(name, value\), Above"),
    ({"period": -1.0}, r"period is -1.0 s; it must be positive"),
    ({"trials": 1e2}, r"trials must be a whole number of at least 1, got 100.0"),
    ({"seed": -(2**70)}, r"seed is -1180591620717411303424; give a whole number that is not negative"),
]


@pytest.mark.parametrize(("options", "told"), MISUSES, ids=[told for _, told in MISUSES])
def test_a_misuse_is_told_in_one_sentence(options, told):
    with pytest.raises((ValueError, TypeError), match=told) as error:
        fly(Entry(115.0), START, **{"trigger": TRIGGER, "end_time": 420.0, "trials": 2} | options)
    assert "\n" not in str(error.value)
