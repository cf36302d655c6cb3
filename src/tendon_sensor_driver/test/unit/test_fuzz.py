# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A short run of the fuzzers of all parsers; the long one is started by hand."""

import importlib
from pathlib import Path
import random

import pytest

REPOSITORY = Path(__file__).parents[4]
if not (REPOSITORY / 'benchmarks').is_dir():
    pytest.skip('the packages are not in their own repository', allow_module_level=True)


@pytest.fixture
def parsers(monkeypatch):
    monkeypatch.syspath_prepend(REPOSITORY)
    return importlib.import_module('benchmarks.fuzz.parsers')


@pytest.fixture
def ati(parsers):
    return importlib.import_module('benchmarks.fuzz.ati')


@pytest.fixture
def error(parsers):
    return importlib.import_module('benchmarks.fuzz.rules').FuzzError


@pytest.mark.parametrize(
    ('name', 'least'),
    [(name, 400) for name in ('lines', 'grbl', 'dynamixel', 'rdt')]
    + [(name, 200) for name in ('digital_ft', 'modbus', 'net_ft_page', 'counter')],
)
def test_a_short_run_finds_samples_and_invents_none(parsers, ati, name, least):
    fuzz = (parsers.FUZZERS | ati.FUZZERS)[name]
    assert fuzz(random.Random(7), 1000) > least


def test_the_harness_sees_an_invented_sample(parsers, error, monkeypatch):
    class Inventive(parsers.LineDecoder):
        def feed(self, data, received_at_ns):
            return [r._replace(value=r.value + 1e-5) for r in super().feed(data, received_at_ns)]

    monkeypatch.setattr(parsers, 'LineDecoder', Inventive)
    with pytest.raises(error, match='invented'):
        parsers.fuzz_lines(random.Random(7), 1000)


def test_the_harness_sees_an_invented_record(ati, error, monkeypatch):
    class Inventive(ati.StreamDecoder):
        def feed(self, data):
            parts = super().feed(data)
            return [part._replace(gauges=part.gauges ^ 1) for part in parts]

    monkeypatch.setattr(ati, 'StreamDecoder', Inventive)
    with pytest.raises(error, match='invented'):
        ati.fuzz_digital_ft(random.Random(7), 1000)


def test_the_harness_sees_a_repeated_sample(ati, error, monkeypatch):
    class Forgetful(ati.CountedStream):
        def add(self, batch):
            blocks = super().add(batch)
            return [*blocks, *blocks]

    monkeypatch.setattr(ati, 'CountedStream', Forgetful)
    with pytest.raises(error, match='repeated'):
        ati.fuzz_counter(random.Random(7), 1000)
