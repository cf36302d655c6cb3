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

"""A short run of the fuzzing harness; the long one is started by hand."""

import importlib.util
from pathlib import Path
import random
import sys

import pytest

HARNESS = Path(__file__).parents[4] / 'benchmarks' / 'fuzz.py'


@pytest.fixture(scope='module')
def fuzz():
    if not HARNESS.exists():
        pytest.skip('the harness is part of the repository, not of the installed package')
    spec = importlib.util.spec_from_file_location('fuzz', HARNESS)
    module = importlib.util.module_from_spec(spec)
    sys.modules['fuzz'] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules['fuzz']


@pytest.mark.parametrize('name', ['lines', 'grbl', 'dynamixel', 'rdt'])
def test_a_short_run_finds_samples_and_invents_none(fuzz, name):
    assert set(fuzz.FUZZERS) >= {'lines', 'grbl', 'dynamixel', 'rdt'}
    assert fuzz.FUZZERS[name](random.Random(7), 1000) > 400


def test_the_harness_sees_an_invented_sample(fuzz, monkeypatch):
    class Inventive(fuzz.LineDecoder):
        def feed(self, data, received_at_ns):
            return [r._replace(value=r.value + 1e-5) for r in super().feed(data, received_at_ns)]

    monkeypatch.setattr(fuzz, 'LineDecoder', Inventive)
    with pytest.raises(fuzz.FuzzError, match='invented'):
        fuzz.fuzz_lines(random.Random(7), 1000)
