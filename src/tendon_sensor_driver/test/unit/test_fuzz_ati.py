# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A short run of the fuzzers of the ATI parsers; the long one is started by hand."""

import importlib
from pathlib import Path
import random
import sys

import pytest

FOLDER = Path(__file__).parents[4] / 'benchmarks'
MODULES = ('fuzz', 'fuzz_ati')


@pytest.fixture
def fuzz_ati(monkeypatch):
    if not (FOLDER / 'fuzz_ati.py').exists():
        pytest.skip('the harness is part of the repository, not of the installed package')
    monkeypatch.syspath_prepend(str(FOLDER))
    for name in MODULES:
        monkeypatch.delitem(sys.modules, name, raising=False)
    yield importlib.import_module('fuzz_ati')
    for name in MODULES:
        sys.modules.pop(name, None)


@pytest.mark.parametrize('name', ['digital_ft', 'modbus', 'net_ft_page', 'counter'])
def test_a_short_run_finds_samples_and_invents_none(fuzz_ati, name):
    assert fuzz_ati.FUZZERS[name](random.Random(7), 1000) > 200


def test_the_harness_sees_an_invented_record(fuzz_ati, monkeypatch):
    class Inventive(fuzz_ati.StreamDecoder):
        def feed(self, data):
            parts = super().feed(data)
            return [part._replace(gauges=part.gauges ^ 1) for part in parts]

    monkeypatch.setattr(fuzz_ati, 'StreamDecoder', Inventive)
    with pytest.raises(fuzz_ati.fuzz.FuzzError, match='invented'):
        fuzz_ati.fuzz_digital_ft(random.Random(7), 1000)


def test_the_harness_sees_a_repeated_sample(fuzz_ati, monkeypatch):
    class Forgetful(fuzz_ati.CountedStream):
        def add(self, batch):
            blocks = super().add(batch)
            return [*blocks, *blocks]

    monkeypatch.setattr(fuzz_ati, 'CountedStream', Forgetful)
    with pytest.raises(fuzz_ati.fuzz.FuzzError, match='repeated'):
        fuzz_ati.fuzz_counter(random.Random(7), 1000)
